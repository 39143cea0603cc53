// SPDX-License-Identifier: Apache-2.0
// What a goal asks, and what may be set.
#include <sstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "scenario/scenario.hpp"
#include "search/goal.hpp"
#include "search/keep.hpp"
#include "search/knobs.hpp"

namespace ontime::search {
namespace {

using testing::AllOf;
using testing::Contains;
using testing::ElementsAre;
using testing::Field;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Key;
using testing::SizeIs;
using testing::StartsWith;

TEST(Goal, EachLimitIsAShareOfMessages) {
  const auto parts = goal_of("p99.9 < 1 ms and late = 0 and lost <= 0.1 % and response max < 5 ms");
  ASSERT_THAT(parts, SizeIs(4));
  EXPECT_EQ(parts[0].limit.text, "p99.9 < 1 ms");
  EXPECT_DOUBLE_EQ(parts[0].limit.share, 0.001);
  EXPECT_DOUBLE_EQ(parts[0].gate.limit, 1e6);
  EXPECT_DOUBLE_EQ(parts[1].limit.share, 0);
  EXPECT_DOUBLE_EQ(parts[2].limit.share, 0.001);
  EXPECT_DOUBLE_EQ(parts[3].limit.share, 0);
  EXPECT_EQ(parts[3].gate.times, statistics::Times::response);
}

TEST(Goal, NoneMayBeAShareToo) {
  for (const auto* text : {"late = 0", "late = 0 %", "late = 0%"})
    EXPECT_EQ(goal_of(text).front().limit.share, 0) << text;
}

TEST(Goal, AnythingButAShareOfMessagesIsRefused) {
  for (const auto* text :
       {"", "mean < 1 ms", "late = 3", "late <= 3", "p99 = 1 ms", "p99 < 1 ms and", "and late = 0",
        "p99 > 1 ms", "p99 << 1 ms", "late =", "p99 < +10%", "p99", "late < 0", "p99 < 0 ms",
        "p99.9 < 1 ms or late = 0", "p99.9 < 1 ms and response lost = 0"})
    EXPECT_THROW(goal_of(text), gate::Error) << text;
}

// As the flag was typed, not as it is parsed.
TEST(Goal, ErrorsHaveTheColumnsAndTheWordsOfTheWholeText) {
  const auto error = [](const std::string& text) -> std::string {
    try {
      goal_of(text);
    } catch (const gate::Error& error) {
      return error.what();
    }
    return "none";
  };
  EXPECT_THAT(error("p99 < 5"), StartsWith("column 8: a unit is missing"));
  EXPECT_THAT(error("p99<5"), StartsWith("column 6: a unit is missing"));
  EXPECT_THAT(error("p99 < 1 ms and foo = 0"), StartsWith("column 16: 'foo'"));
  EXPECT_THAT(error("p99 < 1 µs and  foo = 0"), StartsWith("column 17: 'foo'"));
  EXPECT_THAT(error("p99 < 1 ms and"), StartsWith("column 12: unexpected 'and'"));
  EXPECT_THAT(error("late < 1"), StartsWith("'late < 1': "));
  EXPECT_THAT(error("mean < 1 ms"), StartsWith("'mean < 1 ms': "));
  EXPECT_THAT(error("late > 0"), AllOf(StartsWith("column 6: expected '<', not '>'"), HasSubstr("late = 0")));
}

// 3 late answers and 2 lost messages.
TEST(Goal, LateCountsLostMessagesToo) {
  statistics::Summary run;
  run.late_probability.events = 3;
  run.lost_probability.events = 2;
  run.missed_probability.events = 5;
  run.late_by_response_probability.events = 7;
  for (auto* of : {&run.late_probability, &run.lost_probability, &run.missed_probability,
                   &run.late_by_response_probability}) {
    of->messages = 100;
    of->effect = 2;
  }
  const auto tally = tally_of(goal_of("late = 0").front(), run);
  EXPECT_EQ(tally.events, 5);
  EXPECT_EQ(tally.messages, 100);
  EXPECT_EQ(tally.effect, 2);
  EXPECT_EQ(tally_of(goal_of("lost = 0").front(), run).events, 2);
  EXPECT_EQ(tally_of(goal_of("response late = 0").front(), run).events, 7);
}

TEST(Goal, UnansweredMessagesAreNotWithinALimit) {
  statistics::Summary run;
  run.sent = 6000;
  run.lost = 3020;
  run.skipped_cycles = 20;
  run.lost_probability.effect = 30;
  run.round_trip.count = run.response.count = 2980;
  run.shape.round_trip_ranks = run.shape.response_ranks = {{2980, 100'000}};
  const auto tally = tally_of(goal_of("p99 < 1 ms").front(), run);
  EXPECT_EQ(tally.events, 3020);
  EXPECT_EQ(tally.messages, 6000);
  EXPECT_EQ(tally.effect, 30) << "they may have been lost in a row";
  const auto by_response = tally_of(goal_of("response p99 < 1 ms").front(), run);
  EXPECT_EQ(by_response.events, 3040);
  EXPECT_EQ(by_response.messages, 6020);
}

auto of_key(const std::string& key) { return Field(&Knob::key, key); }
auto left_out(const std::string& key) { return Field(&Knobs::LeftOut::key, key); }

TEST(Knobs, ForbiddenMissingOrPresentSettingsAreLeftOutWithAReason) {
  conditions::Run run;
  run.kernel = {{"rt-throttling", "off"}};
  const Bounds bounds{{"irq-threads", "realtime"}, 80, {0, 1}, [](const Setting& setting) {
                        return std::string(setting.key == "kernel.governor" ? "a virtual machine" : "");
                      }};
  const auto knobs = knobs_of(run, bounds);
  for (const auto* key :
       {"kernel.irq-threads", "realtime", "kernel.governor", "kernel.rt-throttling", "kernel.napi-threads"}) {
    EXPECT_THAT(knobs.knobs, Not(Contains(of_key(key))));
    EXPECT_THAT(knobs.left_out, Contains(left_out(key)));
  }
  EXPECT_THAT(knobs.left_out,
              Contains(AllOf(left_out("kernel.napi-threads"),
                             Field(&Knobs::LeftOut::why, HasSubstr("kernel.threaded-napi: on")))))
      << "the machine may have it on";
  EXPECT_THAT(knobs.knobs, Contains(of_key("kernel.ksoftirqd")));
  EXPECT_THAT(knobs.knobs,
              Contains(AllOf(of_key("kernel.irq-cpus"), Field(&Knob::values, ElementsAre("0", "1")))));
}

conditions::Run realtime_with(const std::string& key, const std::string& value) {
  conditions::Run run;
  conditions::key_named("realtime")->set(run, "on");
  conditions::key_named(key)->set(run, value);
  return run;
}

// Each key of realtime.* switches on all that `realtime: on` does.
TEST(Knobs, MemoryAndIdleStatesAreNoKnobsBesideRealtime) {
  const auto without = knobs_of({}, {{}, 80, {0}});
  for (const auto* key : {"realtime.lock-memory", "realtime.cpu-latency"})
    EXPECT_THAT(without.left_out,
                Contains(AllOf(left_out(key), Field(&Knobs::LeftOut::why, HasSubstr("realtime: on")))));
  EXPECT_THAT(without.knobs,
              Contains(AllOf(of_key("realtime.receive.cpus"), Field(&Knob::part_of, "realtime"))));
  const auto with = knobs_of(realtime_with("realtime.lock-memory", "off"), {{}, 80, {0}});
  EXPECT_THAT(with.knobs, Contains(of_key("realtime.lock-memory")));
  EXPECT_THAT(with.knobs, Contains(AllOf(of_key("realtime.receive.cpus"), Field(&Knob::part_of, ""))));
}

TEST(Knobs, ASettingThatWouldChangeAForbiddenOneIsLeftOut) {
  for (const auto* never : {"realtime.lock-memory", "priority", "realtime"}) {
    const auto knobs = knobs_of({}, {{never}, 80, {0}});
    for (const auto& knob : knobs.knobs) EXPECT_THAT(knob.key, Not(StartsWith("realtime"))) << never;
    EXPECT_THAT(knobs.left_out, Contains(AllOf(left_out("realtime.cpus"),
                                               Field(&Knobs::LeftOut::why, HasSubstr("--never")))));
  }
  EXPECT_THAT(knobs_of({}, {{"cpus"}, 80, {0}}).knobs, Contains(of_key("realtime")));
  const auto of_a_role = knobs_of(realtime_with("realtime.lock-memory", "off"),
                                  {{"realtime.lock-memory", "realtime.receive.priority"}, 80, {0}});
  EXPECT_THAT(of_a_role.knobs, Contains(of_key("realtime.cpus")));
  EXPECT_THAT(of_a_role.knobs, Contains(of_key("realtime.send.priority")));
  EXPECT_THAT(of_a_role.knobs, Not(Contains(of_key("realtime.priority")))) << "it sets that of each role";
}

TEST(Knobs, AValueThatAMachineLacksIsLeftOutAlone) {
  const Bounds bounds{{}, 80, {0, 1}, [](const Setting& setting) {
                        return std::string(setting == Setting{"kernel.irq-cpus", "1"} ? "no CPU 1" : "");
                      }};
  const auto knobs = knobs_of({}, bounds);
  EXPECT_THAT(knobs.knobs,
              Contains(AllOf(of_key("kernel.irq-cpus"), Field(&Knob::values, ElementsAre("0")))));
  EXPECT_THAT(knobs.left_out, Not(Contains(left_out("kernel.irq-cpus"))));
}

TEST(Knobs, NothingIsPutOnACpuWhereThereIsOnlyOne) {
  conditions::Run run;
  run.kernel = {{"threaded-napi", "on"}};
  const auto knobs = knobs_of(run, {{}, 80, {}});
  for (const auto* key : {"kernel.irq-cpus", "kernel.napi-cpus", "realtime.cpus", "realtime.receive.cpus"}) {
    EXPECT_THAT(knobs.knobs, Not(Contains(of_key(key))));
    EXPECT_THAT(knobs.left_out, Contains(left_out(key)));
  }
}

TEST(Knobs, EveryKeyOfTheListIsTriedOrLeftOut) {
  const auto knobs = knobs_of({}, {});
  EXPECT_EQ(knob_keys().size(), knobs.knobs.size() + knobs.left_out.size());
}

TEST(Knobs, ALargerBufferIsNotMadeSmaller) {
  conditions::Run run;
  run.kernel = {{"rmem-max", "8388608"}, {"rmem-default", "8192"}};
  const auto knobs = knobs_of(run, {});
  EXPECT_THAT(knobs.knobs, Not(Contains(of_key("kernel.rmem-max"))));
  EXPECT_THAT(knobs.knobs, Contains(of_key("kernel.rmem-default")));
}

TEST(Knobs, EveryValueIsOneThatAScenarioTakes) {
  conditions::Run run;
  run.kernel = {{"threaded-napi", "on"}};
  for (const auto& knob : knobs_of(run, {{}, 80, {0}}).knobs)
    for (const auto& key : conditions::keys())
      for (const auto& value : knob.values)
        if (key.path == knob.key) {
          EXPECT_NO_THROW(key.set(run, value)) << knob.key;
        }
}

TEST(Knobs, PrioritiesOfTheKernelStayBelowTheBound) {
  for (const auto& knob : knobs_of({}, {{}, 40, {0}}).knobs)
    if (knob.key == "kernel.ksoftirqd") {
      EXPECT_THAT(knob.values, ElementsAre("39"));
    }
}

TEST(Knobs, NoPriorityIsTriedWhereNoneIsBelowTheBound) {
  const auto knobs = knobs_of({}, {{}, 1, {0}});
  for (const auto& knob : knobs.knobs) EXPECT_NE(knob.key, "kernel.ksoftirqd");
  EXPECT_TRUE(std::any_of(knobs.left_out.begin(), knobs.left_out.end(),
                          [](const auto& one) { return one.key == "kernel.ksoftirqd"; }));
}

TEST(Knobs, AReceiveBufferSmallerThanAMessageIsAContradiction) {
  conditions::Run run;
  run.task.client.payload_bytes = 5000;
  run.kernel = {{"rmem-max", "4096"}};
  EXPECT_THAT(contradictions(run), ElementsAre(HasSubstr("rmem-max")));
  run.kernel = {{"rmem-max", "8192"}};
  EXPECT_THAT(contradictions(run), IsEmpty());
}

TEST(Knobs, ReliableWithOneMessageOnALossyLinkIsAContradiction) {
  conditions::Run run;
  run.faults.loss = 0.01;
  run.task.config.qos = {.reliability = transport::Reliability::reliable};
  EXPECT_THAT(contradictions(run), ElementsAre(HasSubstr("qos.depth")));
  run.task.config.qos.depth = 10;
  EXPECT_THAT(contradictions(run), IsEmpty());
}

const Places here = {{"", {{}, "/usr/bin/env"}}};

constexpr const char* lean =
    "hosts: loopback\ndefaults: {kernel.rmem-max: 1 MiB}\n"
    "runs:\n  - id: a\n    transport: udp\n    duration: 1 s\n";

TEST(Keep, TheKeysOfARunCanBePastedAndMeanTheSame) {
  const Set set = {{"realtime", "on"},
                   {"realtime.cpu-latency", "0 us"},
                   {"realtime.receive.cpus", "0"},
                   {"kernel.coalescing", "rx-usecs=0"},
                   {"kernel.rmem-max", "4 MiB"}};
  const std::string stated = lean + std::string("    kernel.rmem-max: 2 MiB\n");  // by the run itself
  scenario::Selection selection;
  selection.set = set;
  for (const auto& text : {std::string(lean), stated}) {
    const auto searched = scenario::parse_scenario("a.yaml", text, selection);
    const auto kept = keep(searched.runs.front(), set, here);
    EXPECT_EQ(kept.run, "a");
    const auto pasted = scenario::parse_scenario("a.yaml", lean + kept.scenario, {});
    EXPECT_EQ(conditions::asked(pasted.runs.front(), pasted.hosts),
              conditions::asked(searched.runs.front(), searched.hosts));
    EXPECT_THROW(scenario::parse_scenario("a.yaml", stated + kept.scenario, {}), scenario::Error)
        << "a key that was not replaced does not win without a word";
  }
}

// As `ontime tune apply` reads them.
settings::Wishes wishes_of(const std::string& command) {
  conditions::Run run;
  std::istringstream words(command);
  for (std::string word; words >> word;) {
    const auto equals = word.find('=');
    for (const auto& key : conditions::keys())
      if (equals != word.npos && key.path == "kernel." + word.substr(0, equals))
        key.set(run, word.substr(equals + 1));
  }
  return run.kernel;
}

TEST(Keep, TheCommandMeansWhatTheSearchFound) {
  Set set;
  conditions::Run run;
  for (const auto& knob : knobs_of({}, {{}, 80, {0}}).knobs)
    for (const auto& key : conditions::keys())
      if (key.path == knob.key && key.path.starts_with("kernel.")) {
        set[knob.key] = knob.values.front();
        key.set(run, knob.values.front());
      }
  EXPECT_THAT(run.kernel, Contains(Key("rmem-max")));
  const auto kept = keep({}, set, here);
  ASSERT_THAT(kept.units, SizeIs(1));
  EXPECT_EQ(wishes_of(kept.units.front().command), run.kernel);
  EXPECT_EQ(wishes_of(kept.units.front().text), run.kernel);
}

const Set of_an_interface = {{"kernel.gro", "off"}, {"kernel.rmem-max", "4 MiB"}, {"realtime", "on"}};

TEST(Keep, TheUnitSetsWhatIsTheKernels) {
  const auto kept = keep({}, of_an_interface, here);
  ASSERT_THAT(kept.units, SizeIs(1));
  const auto& unit = kept.units.front();
  EXPECT_EQ(unit.command,
            "ontime tune apply --set gro=off --set rmem-max=4194304B --interface INTERFACE --print systemd");
  EXPECT_THAT(
      unit.text,
      HasSubstr(
          "ExecStart=/usr/bin/env tune apply --set gro=off --set rmem-max=4194304B --interface INTERFACE"));
  EXPECT_EQ(unit.host + unit.why_not, "");
  EXPECT_THAT(kept.fill_in, HasSubstr("INTERFACE"));
}

// NAPI has threads, whose priority can be set, only with the run's own threaded-napi.
TEST(Keep, TheUnitSetsWhatTheRunItselfAsksOfTheKernelToo) {
  conditions::Run run;
  run.kernel = {{"gro", "on"}, {"rmem-max", "8192"}, {"threaded-napi", "on"}};
  auto kept = keep(run, {{"kernel.napi-threads", "60"}, {"kernel.rmem-max", "4 MiB"}}, here);
  ASSERT_THAT(kept.units, SizeIs(1));
  EXPECT_EQ(kept.units.front().command,
            "ontime tune apply --set gro=on --set napi-threads=60 --set rmem-max=4194304B --set "
            "threaded-napi=on --interface INTERFACE --print systemd");
  EXPECT_THAT(kept.scenario, Not(HasSubstr("gro"))) << "the scenario has it";
  kept = keep(run, {{"realtime", "on"}}, here);
  ASSERT_THAT(kept.units, SizeIs(1));
  EXPECT_THAT(kept.units.front().text, HasSubstr("--set threaded-napi=on"));
  EXPECT_THAT(keep(run, {}, here).units, IsEmpty()) << "nothing is to be changed";
}

TEST(Keep, IsolationOfTheRunIsNamedAsLeftOut) {
  conditions::Run run;
  EXPECT_EQ(keep(run, {{"realtime", "on"}}, here).left_out, "");
  run.isolation.cpus = {1};
  EXPECT_THAT(keep(run, {{"realtime", "on"}}, here).left_out, HasSubstr("isolation.*"));
  EXPECT_EQ(keep(run, {}, here).left_out, "") << "nothing is to be kept";
}

TEST(Keep, AnInterfaceThatIsKnownIsNoPlaceholder) {
  const auto kept =
      keep({}, of_an_interface,
           {{"controller", {{"eth3", ""}, "/usr/bin/env"}}, {"component", {{"eth3", ""}, "/usr/bin/env"}}});
  ASSERT_THAT(kept.units, SizeIs(1));
  EXPECT_THAT(kept.units.front().text, HasSubstr("--interface eth3\n"));
  EXPECT_EQ(kept.units.front().host + kept.fill_in, "");
}

TEST(Keep, HostsWithOtherInterfacesHaveAUnitEach) {
  const auto kept =
      keep({}, of_an_interface,
           {{"controller", {{"eth3", ""}, "/usr/bin/env"}}, {"component", {{"eth0", ""}, "/usr/bin/env"}}});
  ASSERT_THAT(kept.units, SizeIs(2));
  EXPECT_EQ(kept.units[0].host, "component");
  EXPECT_THAT(kept.units[0].text, HasSubstr("--interface eth0\n"));
  EXPECT_THAT(kept.units[1].text, HasSubstr("--interface eth3"));
}

TEST(Keep, AnInterfaceInANetworkNamespaceHasNoUnit) {
  const auto kept = keep({}, of_an_interface, {{"component", {{"eth0", "robot"}, "/usr/bin/env"}}});
  ASSERT_THAT(kept.units, SizeIs(1));
  EXPECT_EQ(kept.units[0].text, "");
  EXPECT_THAT(kept.units[0].why_not, HasSubstr("robot"));
}

TEST(Keep, AnUnknownInterfaceOfOneHostHasAPlaceholder) {
  const auto kept =
      keep({}, of_an_interface,
           {{"controller", {{"eth3", ""}, "/usr/bin/env"}}, {"component", {{"", ""}, "/usr/bin/env"}}});
  ASSERT_THAT(kept.units, SizeIs(2));
  EXPECT_THAT(kept.units[0].text, HasSubstr("--interface INTERFACE"));
  EXPECT_THAT(kept.fill_in, HasSubstr("INTERFACE"));
}

// Of another machine, ontime cannot tell here who may change a program.
TEST(Keep, EachUnitStartsTheProgramOfItsHost) {
  const auto units = [](const std::string& program_there) {
    return keep({}, {{"kernel.ksoftirqd", "60"}},
                {{"controller", {{}, "/usr/bin/env"}}, {"component", {{}, program_there, false}}})
        .units;
  };
  const auto other = units("/opt/robot/bin/ontime");
  ASSERT_THAT(other, SizeIs(2));
  EXPECT_EQ(other[0].host, "component");
  EXPECT_THAT(other[0].text, HasSubstr("ExecStart=/opt/robot/bin/ontime tune apply "));
  EXPECT_THAT(other[1].text, HasSubstr("ExecStart=/usr/bin/env tune apply "));
  const auto same = units("/usr/bin/env");
  ASSERT_THAT(same, SizeIs(1));
  EXPECT_EQ(same[0].host, "");
  const auto copied = units("");
  ASSERT_THAT(copied, SizeIs(2));
  EXPECT_EQ(copied[0].text, "");
  EXPECT_THAT(copied[0].why_not, HasSubstr("install"));
}

TEST(Keep, SettingsOfNoInterfaceNeedNone) {
  const auto kept = keep({}, {{"kernel.ksoftirqd", "60"}},
                         {{"a", {{"eth3", ""}, "/usr/bin/env"}}, {"b", {{"", ""}, "/usr/bin/env"}}});
  ASSERT_THAT(kept.units, SizeIs(1));
  EXPECT_THAT(kept.units.front().text, Not(HasSubstr("--interface")));
  EXPECT_EQ(kept.fill_in, "");
}

TEST(Keep, SettingsOfAProcessNeedNoUnitAndAnEmptySetNothing) {
  const auto of_process = keep({}, {{"realtime", "on"}}, here);
  EXPECT_EQ(of_process.scenario, "    realtime: on\n");
  EXPECT_THAT(of_process.units, IsEmpty());
  EXPECT_EQ(keep({}, {}, here).scenario, "");
}

class Causes : public testing::Test {
 protected:
  std::vector<Finding> of(std::int32_t culprit_priority, const Bounds& bounds,
                          std::int64_t slow_ns = 1'000'000) {
    explain::Account account;
    explain::Message message{};
    message.sample.sent_ns = 1;
    message.sample.received_ns = 2'000'001;
    message.parts = {{.cause = cause_,
                      .stage = explain::Stage::travelled,
                      .end = "component",
                      .thread = "napi/eth1-1",
                      .culprit = "hog",
                      .culprit_priority = culprit_priority,
                      .ns = 1}};
    account.messages = {message, message};
    return findings_of(account, run_, slow_ns, bounds);
  }
  explain::Cause cause_ = explain::Cause::cpu;
  record::Run run_;
};

TEST_F(Causes, ARuleBecomesValuesWithinTheBounds) {
  const auto found = of(120, {{}, 80, {0, 1}});
  ASSERT_THAT(found, SizeIs(1));
  EXPECT_EQ(found.front().messages, 2);
  EXPECT_THAT(found.front().remedies,
              ElementsAre(Setting{"kernel.napi-threads", "60"}, Setting{"kernel.napi-cpus", "0"},
                          Setting{"kernel.napi-cpus", "1"}));
}

TEST_F(Causes, AboveARealTimeCulpritIsOneMoreThanItsPriority) {
  EXPECT_THAT(of(99 - 70, {{}, 80, {}}).front().remedies, ElementsAre(Setting{"kernel.napi-threads", "71"}));
}

TEST_F(Causes, APriorityBeyondTheBoundIsNotProposed) {
  EXPECT_THAT(of(99 - 90, {{}, 80, {}}).front().remedies, IsEmpty());
}

TEST_F(Causes, MemoryThatIsNotLockedIsRemediedByRealtimeUnlessThatIsOn) {
  cause_ = explain::Cause::page_fault;
  EXPECT_THAT(of(120, {}).front().remedies, ElementsAre(Setting{"realtime", "on"}));
  run_.asked.task.realtime.on = true;
  EXPECT_THAT(of(120, {}).front().remedies, ElementsAre(Setting{"realtime.lock-memory", "on"}));
}

TEST_F(Causes, MessagesThatBreakNoLimitAreNoCause) {
  EXPECT_THAT(of(120, {{}, 80, {}}, 5'000'000), IsEmpty());
}

}  // namespace
}  // namespace ontime::search

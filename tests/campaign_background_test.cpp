// SPDX-License-Identifier: Apache-2.0
// Ordinary topics beside the critical one, and searches for how far they can be turned up.
#include "campaign/background_topics.hpp"
#include "campaign/search.hpp"
#include "campaign_scenario.hpp"

namespace ontime::campaign {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;

class BackgroundTopics : public ScenarioFile {
 protected:
  static std::string with(const std::string& background, const std::string& transport = "cyclonedds",
                          const std::string& more = "") {
    return "runs: [{id: a, transport: " + transport + more + ", background: {" + background + "}}]\n";
  }
};

TEST_F(BackgroundTopics, OtherKeysWithoutTopicsAreRefused) {
  EXPECT_EQ(read("runs: [{id: a, transport: udp}]\n").runs[0].task.background.topics, 0);
  EXPECT_THAT(error(with("rate: 200 Hz")), HasSubstr("set background.topics"));
  EXPECT_THAT(error(with("rate: 100 Hz")), HasSubstr("set background.topics")) << "though it is usual";
  EXPECT_THAT(error("runs: [{id: a, transport: cyclonedds, background: 4}]\n"),
              HasSubstr("background: keys and values are needed here, such as background: {topics: …}"));
}

TEST_F(BackgroundTopics, AllKeysAreReadAndRecorded) {
  const auto run =
      read(with("topics: 3, where: other-process, rate: 250 Hz, payload: 2 KiB, reliability: reliable, "
                "direction: to-controller, priority: 40, callback: 1.5 ms"))
          .runs[0];
  const auto& background = run.task.background;
  EXPECT_EQ(background.topics, 3);
  EXPECT_EQ(background.where, roundtrip::Where::other_process);
  EXPECT_EQ(background.period, 4ms);
  EXPECT_EQ(background.payload_bytes, 2048U);
  EXPECT_EQ(background.reliability, transport::Reliability::reliable);
  EXPECT_FALSE(background.there);
  EXPECT_TRUE(background.back);
  EXPECT_EQ(background.priority, 40);
  const auto record = asked(run, {}).at("neighbours");
  EXPECT_EQ(record.at("rate_hz"), 250);
  EXPECT_EQ(record.at("where"), "other-process");
  EXPECT_EQ(record.at("callback_us"), 1500);
}

TEST_F(BackgroundTopics, InvalidValuesAreRefusedWithTheirPlace) {
  for (const auto& [wrong, why] : {std::pair("topics: 0", "from 1 to 100"),
                                   {"topics: 101", "from 1 to 100"},
                                   {"topics: 1, rate: 10", "has no unit"},
                                   {"topics: 1, rate: 0 Hz", "0.1 Hz to 100 kHz"},
                                   {"topics: 1, rate: 200 kHz", "0.1 Hz to 100 kHz"},
                                   {"topics: 1, rate: -1 Hz", "0.1 Hz to 100 kHz"},
                                   {"topics: 1, payload: 2 GiB", "too large"},
                                   {"topics: 100, payload: 16 MiB", "1 GiB"},
                                   {"topics: 1, where: beside", "is not one of same-participant"},
                                   {"topics: 1, direction: up", "is not one of both"},
                                   {"topics: 1, priority: 100", "from 1 to 99"},
                                   {"topics: 1, callback: 0 ms", "must be positive"},
                                   {"topics: 1, callback: 2", "has no unit"},
                                   {"topics: 1, callback: 2 h", "at most 1 h"},
                                   {"topics: 1, number: 2", "unknown key 'background.number'"}})
    EXPECT_THAT(error(with(wrong)), AllOf(HasSubstr(":1:"), HasSubstr(why))) << wrong;
  EXPECT_THAT(error(with("topics: 10, rate: 20 kHz")), HasSubstr("100000 messages"));
  EXPECT_THAT(error(with("topics: 1", "cyclonedds", ", component: {restart: on}")),
              HasSubstr("component.restart"));
}

TEST_F(BackgroundTopics, TransportWithoutTopicsIsRefusedByName) {
  EXPECT_THAT(error(with("topics: 1", "udp")),
              AllOf(HasSubstr("transport udp has no topics"), HasSubstr("traffic")));
  EXPECT_THAT(error(with("topics: 1", "cyclonedds", ", component: {transport: udp}")),
              HasSubstr("transport udp has no topics"));
  EXPECT_THAT(error(with("topics: 1, where: other-process", "ethernet")), HasSubstr("transport ethernet"));
}

TEST_F(BackgroundTopics, NodesAndExecutorsNeedRos2) {
  for (const auto* where : {"same-callback-group", "same-node", "same-executor", "own-executor"}) {
    const auto inside = std::string("topics: 1, where: ") + where;
    EXPECT_EQ(error(with(inside, "ros2")), "no error");
    EXPECT_THAT(error(with(inside)), AllOf(HasSubstr(where), HasSubstr("cyclonedds has no nodes"))) << where;
    EXPECT_THAT(error(with(inside, "ros2", ", component: {transport: fastdds}")),
                HasSubstr("fastdds has no nodes"));
    EXPECT_THAT(error(with(inside, "ros2", ", receive: waitset")),
                AllOf(HasSubstr(where), HasSubstr("receive: listener")));
  }
  EXPECT_EQ(error(with("topics: 1, where: same-process", "ros2", ", receive: waitset")), "no error");
  EXPECT_THAT(error(with("where: same-node", "ros2")), HasSubstr("set background.topics"));
  EXPECT_THAT(error(with("callback: 1 ms", "ros2")), HasSubstr("set background.topics"));
}

TEST_F(BackgroundTopics, TopicNamesAreValidInRos) {
  EXPECT_EQ(roundtrip::background_topic("/robot/arm/ping", 7), "/robot/arm/background_7/ping");
  const std::string longest(240, 'x');
  EXPECT_EQ(error("runs: [{id: a, transport: cyclonedds, topics: {ping: " + longest + "}}]\n"), "no error");
  EXPECT_THAT(error(with("topics: 1", "cyclonedds", ", topics: {ping: " + longest + "}")),
              HasSubstr("longer than 247 characters"));
}

json end_of(std::uint64_t sent, std::uint64_t received, std::uint64_t skipped = 0,
            std::uint64_t overruns = 0) {
  return {{"sent", sent}, {"received", received}, {"refused", 0}, {"skipped_cycles", skipped},
          {"strays", 0},  {"overruns", overruns}};
}
json outcome_of(json controller, json component) {
  json outcome;
  outcome["hosts"]["controller"]["neighbours"] = std::move(controller);
  outcome["hosts"]["component"]["neighbours"] = std::move(component);
  return outcome;
}

TEST(BackgroundAccount, LostIsSentLessReceived) {
  const auto both = achieved({}, outcome_of(end_of(100, 48), end_of(50, 98)));
  EXPECT_EQ(both.at("to_component").lost, 2u);
  EXPECT_EQ(both.at("to_controller").lost, 2u);
  EXPECT_FALSE(both.at("to_component").is_short);
  EXPECT_TRUE(shortfalls_of_background(both).empty());
  const auto there = achieved({.back = false}, outcome_of(end_of(100, 0), end_of(0, 100)));
  EXPECT_FALSE(there.contains("to_controller"));
}

// To the component alone.
record::BackgroundSeen there(const json& sender, const json& receiver) {
  return achieved({.back = false}, outcome_of(sender, receiver)).at("to_component");
}
std::vector<std::string> told(const json& sender, const json& receiver) {
  return shortfalls_of_background(achieved({.back = false}, outcome_of(sender, receiver)));
}

TEST(BackgroundAccount, SkippedCyclesAboveFivePercentAreAShortfall) {
  EXPECT_TRUE(there(end_of(94, 0, 6), end_of(0, 94)).is_short);
  EXPECT_THAT(told(end_of(94, 0, 6), end_of(0, 94)),
              ElementsAre(AllOf(HasSubstr("94 of 100"), HasSubstr("component"), HasSubstr("6 not sent"),
                                Not(HasSubstr("lost")))));
  EXPECT_FALSE(there(end_of(95, 0, 5), end_of(0, 95)).is_short);
}

TEST(BackgroundAccount, LossAboveFivePercentIsAShortfall) {
  EXPECT_TRUE(there(end_of(100, 0), end_of(0, 94)).is_short);
  EXPECT_THAT(told(end_of(100, 0), end_of(0, 94)),
              ElementsAre(AllOf(HasSubstr("94 of 100"), HasSubstr("component"), HasSubstr("6 lost"),
                                Not(HasSubstr("not sent")))));
  EXPECT_FALSE(there(end_of(100, 0), end_of(0, 95)).is_short);
  EXPECT_TRUE(there(end_of(97, 0, 3), end_of(0, 94)).is_short) << "some of both";
}

TEST(BackgroundAccount, MessagesThatRequestedFaultsDropAreNoShortfall) {
  const auto is_short = [](std::uint64_t arrived) {
    const auto outcome = outcome_of(end_of(1000, 0), end_of(0, arrived));
    return achieved({.back = false}, outcome, {}, 0.9).at("to_component").is_short;
  };
  EXPECT_FALSE(is_short(880));
  EXPECT_TRUE(is_short(850));
}

TEST(BackgroundAccount, OverrunsAboveFivePercentAreAShortfall) {
  EXPECT_TRUE(there(end_of(60, 0), end_of(0, 60, 0, 4)).is_short) << "more than 5 % of 60";
  EXPECT_THAT(told(end_of(60, 0), end_of(0, 60, 0, 4)),
              ElementsAre(AllOf(HasSubstr("60 of 60"), HasSubstr("4 with a callback"))));
  EXPECT_FALSE(there(end_of(60, 0), end_of(0, 60, 0, 3)).is_short);
}

TEST(BackgroundAccount, SenderThatNeverRanIsAShortfall) {
  const roundtrip::BackgroundOptions asked{
      .topics = 1, .period = std::chrono::milliseconds(10), .back = false};
  const auto none = outcome_of(end_of(0, 0), end_of(0, 0));
  EXPECT_TRUE(achieved(asked, none, std::chrono::seconds(1)).at("to_component").is_short);
  EXPECT_FALSE(achieved(asked, none).at("to_component").is_short) << "the run was stopped";
}

TEST(BackgroundAccount, IncompletePeriodRequestsNoMessage) {
  const auto is_short = [](auto period, auto duration, std::uint64_t sent) {
    return achieved({.topics = 1, .period = period, .back = false},
                    outcome_of(end_of(sent, 0), end_of(0, sent)), duration)
        .at("to_component")
        .is_short;
  };
  EXPECT_FALSE(is_short(1s, 2400ms, 2));
  EXPECT_TRUE(is_short(1s, 2400ms, 1));
  EXPECT_FALSE(is_short(2s, 5s, 2));
}

TEST(BackgroundInAProcessOfTheirOwn, OwnProcessHasNoRealtimeSettings) {
  agent::Task task;
  task.realtime.on = task.count_instructions = true;
  const auto own = of_their_own(task);
  EXPECT_FALSE(own.realtime.on);
  EXPECT_FALSE(own.count_instructions);
}

// Of a search that is missed from a value on; returns what it tried.
std::vector<int> tried(int values, int first_missed, Search search) {
  std::vector<int> all;
  while (const auto next = search.next()) {
    all.push_back(*next);
    search.tell(*next >= first_missed);
    EXPECT_LE(all.size(), static_cast<std::size_t>(values)) << "it comes to an end";
  }
  for (const auto found : {first_missed - 1, first_missed}) {
    const bool is_one = found >= 0 && found < values;
    EXPECT_EQ(std::count(all.begin(), all.end(), found), is_one ? 1 : 0) << found;
  }
  return all;
}

TEST(Search, FindsLastPassAndFirstMiss) {
  for (int values = 2; values < 40; ++values)
    for (int first_missed = 0; first_missed <= values; ++first_missed)
      tried(values, first_missed, Search(values));
  EXPECT_THAT(tried(20, 5, Search(20)), ElementsAre(0, 1, 3, 7, 5, 4))
      << "from the gentlest, and no harsher than it must";
  EXPECT_THAT(tried(20, 0, Search(20)), ElementsAre(0));
}

constexpr const char* searched =
    "runs: [{id: a, transport: [cyclonedds, fastdds], search: background.rate, background: {topics: 1, rate: "
    "[100 Hz, 200 Hz, 400 Hz], where: [same-participant, other-process]}}]\n";

TEST_F(BackgroundTopics, SearchStepsFollowEachOther) {
  const auto scenario = read(searched);
  ASSERT_EQ(scenario.runs.size(), 12U);
  for (std::size_t i = 0; i < scenario.runs.size(); ++i) {
    const auto& step = scenario.runs[i].step;
    EXPECT_EQ(step.key, "background.rate");
    EXPECT_EQ(step.number, static_cast<int>(i % 3));
    EXPECT_EQ(step.of, 3);
    EXPECT_THAT(step.among, testing::StartsWith("background.where ")) << "not the rate";
  }
  EXPECT_EQ(scenario.runs[1].step.value, "200 Hz");
  EXPECT_THAT(scenario.runs[1].variant, HasSubstr("background.rate 200 Hz"));
  EXPECT_EQ(scenario.runs[0].task.transport, scenario.runs[5].task.transport);
  EXPECT_EQ(read("runs: [{id: a, transport: udp}]\n").runs[0].step.of, 0);
}

TEST_F(BackgroundTopics, SearchNeedsOneKeyWithAList) {
  const auto of = [this](const std::string& search) {
    return error("runs:\n  - {id: a, transport: [udp, fastdds], payload: [1 kB, 2 kB],\n     search: " +
                 search + "}\n");
  };
  EXPECT_EQ(of("payload"), "no error");
  EXPECT_THAT(of("period"), AllOf(HasSubstr(":3:14: search: 'period'")));
  EXPECT_THAT(of("[payload, period]"), HasSubstr("one key at a time"));
  EXPECT_THAT(of("transport"), HasSubstr("transports have no order"));
}

TEST_F(BackgroundTopics, SearchedQuantitiesRiseOrFall) {
  const auto of = [this](const std::string& values) {
    return error("runs:\n  - {id: a, transport: cyclonedds, search: period, period: [" + values + "]}\n");
  };
  EXPECT_EQ(of("1 ms, 0.01 s, 100 ms"), "no error");
  EXPECT_EQ(of("100 ms, 0.01 s, 1 ms"), "no error");
  EXPECT_EQ(error("runs: [{id: a, transport: udp, search: domain, domain: [46, 0, 8]}]\n"), "no error");
  EXPECT_THAT(of("1 ms, 100 ms, 10 ms"),
              AllOf(HasSubstr(":2:"), HasSubstr("'period' neither rise nor fall")));
}

}  // namespace
}  // namespace ontime::campaign

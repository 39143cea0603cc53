// SPDX-License-Identifier: Apache-2.0
#include <filesystem>
#include <fstream>
#include <regex>
#include <set>

#include <gtest/gtest.h>

#include "record/outcome.hpp"

namespace ontime::record {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;

// The names in the lists of fields of a struct, and of those below it.
struct Names {
  std::set<std::string> all{};

  void add(const auto&) {}
  template <typename Value>
  void add(const std::vector<Value>&) {
    add(Value());
  }
  template <typename Value>
  void add(const std::optional<Value>&) {
    add(Value());
  }
  template <typename Value>
  void add(const ByName<Value>&) {
    add(Value());
  }
  template <typename Value>
  requires requires(Value& value) {
    Value::fields(value, [](const char*, auto&, auto...) {});
  }
  void add(const Value& value) {
    Value::fields(value, [&](const char* name, const auto& member, auto...) {
      all.insert(name);
      add(member);
    });
  }
};

TEST(Outcome, EachNameIsInTheReference) {
  std::set<std::string> words;
  for (const auto& page : std::filesystem::directory_iterator(ONTIME_TEST_DATA "/../../docs/reference")) {
    std::ifstream file(page.path());
    const std::string text(std::istreambuf_iterator<char>(file), {});
    static const std::regex word("[a-z][a-z0-9_]*");
    for (std::sregex_iterator one(text.begin(), text.end(), word), end; one != end; ++one)
      words.insert(one->str());
  }
  Outcome with_counters;
  with_counters.has_counters = true;
  Names names;
  names.add(with_counters);
  names.add(Asked());
  names.add(LateCause());
  EXPECT_GT(names.all.size(), 100u);
  for (const auto& name : names.all)
    EXPECT_TRUE(words.contains(name)) << name << " is in no page of docs/reference";
}

TEST(Outcome, RunThatWasCutOffHasNone) {
  EXPECT_FALSE(Outcome().has_ended());
  EXPECT_TRUE(Outcome(json::object()).has_ended());
}

TEST(Outcome, MembersAreReadByTheirNames) {
  const Outcome of(json{{"late", 3},
                        {"trailing_due_ns", -5},
                        {"hosts",
                         {{"component",
                           {{"load_running", false},
                            {"threads", {{{"role", "send"}, {"tid", 7}, {"cpu_time_us", 1.5}}}},
                            {"kernel", {{{"setting", "x"}, {"after", 1}, {"now", nullptr}}}},
                            {"machine", {{"boot_id", "b"}, {"cpu_model", "m"}}}}}}},
                        {"traffic", {{"to_component", {{"short", true}}}}},
                        {"trace", json::object()}});
  const auto& host = find(of.hosts, "component");
  EXPECT_EQ(of.counters.late, 3u);
  EXPECT_EQ(of.counters.trailing_due_ns, -5);
  EXPECT_EQ(host.load_running, false);
  EXPECT_EQ(host.threads.at(0).tid, 7);
  EXPECT_EQ(host.threads.at(0).cpu_time_us, 1.5);
  EXPECT_FALSE(host.kernel.at(0).lasted());
  EXPECT_EQ(host.machine.document.at("cpu_model"), "m");
  EXPECT_EQ(find(of.traffic, "to_component").is_short, true);
  EXPECT_FALSE(find(of.traffic, "to_controller").is_short);
  EXPECT_TRUE(of.trace.has_value());
  EXPECT_FALSE(on_one_machine(of));
}

TEST(Outcome, MembersOfAnotherKindAreAsIfMissing) {
  for (const auto& odd :
       {json(-1), json(1.5), json("text"), json::array({1, "x"}), json{{"a", {{"b", 1}}}}}) {
    json document;
    for (const auto* name : {"late", "interrupted", "hosts", "traffic", "trace", "histogram", "conditions"})
      document[name] = odd;
    const Outcome of(document);
    EXPECT_EQ(of.counters.late, 0u) << odd;
    EXPECT_TRUE(of.misfit) << odd;
    EXPECT_FALSE(of.interrupted) << odd;
    EXPECT_TRUE(find(of.hosts, "controller").threads.empty()) << odd;
    EXPECT_FALSE(find(of.hosts, "a").load_running) << odd;
    EXPECT_NO_THROW(Outcome{odd}) << odd;
    EXPECT_NO_THROW(Asked{odd}) << odd;
  }
}

TEST(Outcome, TheFirstMemberOfAnotherKindIsNamed) {
  const auto misfit = [](json from) { return misfit_of({}, Outcome(std::move(from))); };
  EXPECT_EQ(misfit({{"late", 3}, {"lost", nullptr}, {"of a later ontime", "x"}}), "");
  EXPECT_EQ(misfit({{"late", "3"}}), "outcome.late");
  EXPECT_EQ(misfit({{"late", -3}}), "outcome.late");
  EXPECT_EQ(misfit(5), "outcome");
  EXPECT_EQ(misfit({{"hosts", {{"component", {{"threads", {{{"tid", 7}}, {{"tid", "seven"}}}}}}}}}),
            "outcome.hosts.component.threads.1.tid");
  EXPECT_EQ(misfit({{"hosts", {{"component", {{"load", {{"hdd_bytes", -1}}}}}}}}),
            "outcome.hosts.component.load.hdd_bytes");
  const Outcome odd_load(json{{"hosts", {{"component", {{"load", "x"}}}}}});
  EXPECT_EQ(odd_load.misfit, "hosts.component.load");
  EXPECT_TRUE(odd_load.hosts.at("component").load) << "an older ontime noted none";
  EXPECT_EQ(misfit({{"conditions", {{"controller", {{"cpu_stolen", "much"}}}}}}),
            "outcome.conditions.controller.cpu_stolen");
  EXPECT_EQ(misfit({{"hosts", {{"component", {{"transport", {{"facts", {{"domain", 7}}}}}}}}}}), "");
  EXPECT_EQ(misfit_of(Asked(json{{"wire", {{"vlan", "one"}}}}), {}), "asked.wire.vlan");
}

TEST(Outcome, ErrorThatIsNoTextIsAnError) {
  EXPECT_EQ(Outcome(json{{"error", 5}}).error, "5");
  EXPECT_FALSE(Outcome(json{{"error", nullptr}}).error);
}

TEST(Outcome, MembersAreWrittenByTheSameNames) {
  Outcome one;
  one.has_counters = true;
  one.counters.late = 3;
  auto& host = one.hosts["component"];
  host.machine = read<Machine>({{"boot_id", "b"}, {"cpu_model", "m"}});
  host.threads.emplace_back().tid = 7;
  host.link.interface = "eth1";
  host.link.etf = {5, 0};
  host.load.emplace().hdd_bytes = 4096;
  one.traffic["to_component"].asked_bit_s = 80'000'000;
  const auto written = to_json(one);
  EXPECT_EQ(written.at("late"), 3);
  EXPECT_EQ(written.at("/hosts/component/machine/cpu_model"_json_pointer), "m") << "as it was reported";
  EXPECT_EQ(written.at("/hosts/component/link/etf/launched_frames"_json_pointer), 5);
  EXPECT_TRUE(written.at("/traffic/to_component/asked_bit_s"_json_pointer).is_number_integer());
  const Outcome again(written);
  EXPECT_FALSE(again.misfit);
  EXPECT_EQ(to_json(again), written);
  const auto& same = again.hosts.at("component");
  EXPECT_EQ(same.threads.at(0).tid, 7);
  EXPECT_EQ(same.load->hdd_bytes, 4096u);
  EXPECT_FALSE(same.link.faults);
}

TEST(Outcome, QuotaCountsWhereMeasuringThreadsAreOrdinary) {
  Outcome of;
  for (const auto* name : both_hosts) {
    auto& host = of.hosts[name];
    for (const auto& [role, policy] : {std::pair("send", "fifo"), {"timer", "other"}}) {
      auto& thread = host.threads.emplace_back();
      thread.role = role;
      thread.policy = policy;
    }
    host.cpu_quota = {0.5, 3, name == std::string("component") ? 400u : 300u};
  }
  of = Outcome(to_json(of));
  EXPECT_FALSE(of.misfit);
  EXPECT_TRUE(throttled(of).empty()) << "a quota does not stop real-time threads";
  of.hosts["component"].threads[0].policy = "other";
  ASSERT_EQ(throttled(of).size(), 1u);
  EXPECT_EQ(throttled(of)[0].first, "the component's");
  of.hosts["controller"].threads[0].policy = "other";
  EXPECT_EQ(throttled(of).size(), 2u);
  for (const auto* name : both_hosts) of.hosts[name].machine.boot_id = "b";
  ASSERT_EQ(throttled(of).size(), 1u) << "one group, as a rule";
  EXPECT_EQ(throttled(of)[0].first, "ontime's");
  EXPECT_EQ(throttled(of)[0].second.throttled_ns, 400u);
}

TEST(Outcome, UnknownMembersAreNullOrNotWritten) {
  EXPECT_EQ(to_json(Outcome()), json({{"interrupted", false}})) << "nothing was counted";
  Host unknown;
  const auto host = to_json(unknown);
  for (const auto* null : {"link", "neighbours", "load_running", "ssh_link", "answered"})
    EXPECT_TRUE(host.at(null).is_null()) << null;
  for (const auto* missing : {"kernel", "isolation", "settings", "load", "started_again", "cpu_quota"})
    EXPECT_FALSE(host.contains(missing)) << missing;
  EXPECT_TRUE(host.at("threads").is_array());
  unknown.load.emplace();
  EXPECT_EQ(to_json(unknown).at("load"), json::object()) << "noted, of workers without a size";
  Traced traced;
  EXPECT_EQ(to_json(traced), json({{"missing", json::array()}}));
  traced.error = "no tracefs";
  EXPECT_EQ(to_json(traced), json({{"error", "no tracefs"}}));
}

TEST(Asked, TimesThatAreNotStatedAreZero) {
  const Asked asked(json{{"id", "a"}, {"period_us", 1000}, {"deadline_us", "soon"}});
  EXPECT_EQ(asked.id, "a");
  EXPECT_EQ(asked.task.client.period, 1ms);
  EXPECT_EQ(asked.task.client.deadline, 0ns);
  EXPECT_EQ(asked.task.client.timeout, 0ns);
  EXPECT_EQ(asked.task.client.payload_bytes, 0u);
}

TEST(Asked, NumbersAmongKernelSettingsOfAnOlderRecordAreRead) {
  const Asked asked(json{{"kernel", {{"ksoftirqd", 60}, {"rt-throttling", "off"}}}});
  EXPECT_EQ(asked.kernel.at("ksoftirqd"), "60");
}

}  // namespace
}  // namespace ontime::record

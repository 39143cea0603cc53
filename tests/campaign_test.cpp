// SPDX-License-Identifier: Apache-2.0
#include "campaign/campaign.hpp"

#include <filesystem>
#include <map>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "campaign/pollers.hpp"
#include "campaign_scenario.hpp"

namespace ontime::campaign {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;

std::vector<std::string> words(const Scenario& scenario) {
  std::vector<std::string> result;
  for (std::size_t i = 0; i < scenario.size(); ++i) {
    const auto run = scenario.at(i);
    result.push_back(run.id + " " + run.task.transport + " " + std::to_string(run.task.client.payload_bytes) +
                     " " + std::to_string(run.repetition));
  }
  return result;
}

TEST(Pollers, UnthrottledPollersOnEveryCpuAreRefused) {
  EXPECT_THAT(why_refused(2, false, {{}, {}}), AllOf(HasSubstr("2 real-time threads"), HasSubstr("2 CPUs")));
  EXPECT_THAT(why_refused(2, false, {{0}, {1}}), HasSubstr("realtime.receive.cpus"));
  EXPECT_THAT(why_refused(2, false, {{0}, {}}), HasSubstr("kernel.rt-throttling: on"));
  EXPECT_THAT(why_refused(1, false, {{}}), HasSubstr("on 1 CPUs"));
  EXPECT_EQ(why_refused(2, true, {{}, {}}), "");
  EXPECT_EQ(why_refused(2, false, {{}}), "");
  EXPECT_EQ(why_refused(2, false, {{0, 1}}), "") << "one thread takes one CPU at a time";
  EXPECT_NE(why_refused(2, false, {{0, 1}, {0, 1}}), "");
  EXPECT_EQ(why_refused(2, false, {{1}, {1}}), "") << "both on one CPU leave the other free";
  EXPECT_EQ(why_refused({}, false, {{}, {}}), "") << "it does not say how many CPUs it has";
}

TEST(Pollers, OnlyARuntimeBelowThePeriodThrottles) {
  const auto throttled = [](std::optional<std::int64_t> runtime, const settings::Wishes& kernel = {}) {
    record::Machine machine;
    machine.rt_runtime_us = runtime;
    machine.rt_period_us = 1'000'000;
    return is_throttled(machine, kernel);
  };
  EXPECT_TRUE(throttled(950'000));
  EXPECT_TRUE(throttled(0));
  EXPECT_FALSE(throttled(-1));
  EXPECT_FALSE(throttled(1'000'000)) << "the whole period";
  EXPECT_FALSE(throttled({})) << "the machine does not tell";
  EXPECT_TRUE(throttled(-1, {{"rt-throttling", "on"}}));
  EXPECT_FALSE(throttled(950'000, {{"rt-throttling", "off"}}));
}

TEST_F(ScenarioFile, PlanCountsOnlyTheTimeOfWhatIsNotInTheResults) {
  const auto scenario = read(
      "hosts: loopback\n"
      "repeat: 2\n"
      "defaults: {transport: udp}\n"
      "runs:\n"
      "  - {id: a, duration: 10 s}\n"
      "  - {id: b, duration: 20 s}\n"
      "  - {id: c, search: period, period: [2 ms, 1 ms]}\n");
  const auto all = plan_of(scenario);
  EXPECT_EQ(all.runs, 8U);
  EXPECT_EQ(all.known, 0U);
  EXPECT_EQ(all.time, time_of(scenario));
  const record::Outcome outcome;
  const auto resumed = plan_of(scenario, [&](const json& asked, const auto& machines) {
    EXPECT_TRUE(machines.empty());
    EXPECT_EQ(asked.at("hosts"), "loopback");
    EXPECT_EQ(asked.at("scenario"), scenario.text);
    const bool is_there = asked.at("id") != "a" || asked.at("repetition") == 1;
    return is_there ? &outcome : nullptr;
  });
  EXPECT_EQ(resumed.runs, 8U);
  EXPECT_EQ(resumed.known, 3U) << "a once, b twice; a search chooses its steps";
  const auto steps = time_of(scenario.runs[2]) + time_of(scenario.runs[3]);
  EXPECT_NEAR(resumed.time.count(), (time_of(scenario.runs[0]) + 2 * steps).count(), 1e-6);
}

TEST_F(ScenarioFile, LoadTakesTimeToStart) {
  const auto scenario = read(
      "hosts: loopback\n"
      "defaults: {transport: udp, duration: 20 ms}\n"
      "runs: [{id: a}, {id: b, load: {controller: {cpu: 1}}}]\n");
  EXPECT_LT(time_of(scenario.runs[0]).count(), 1);
  EXPECT_GT(time_of(scenario.runs[1]).count(), 2);
}

TEST_F(ScenarioFile, DefaultsHoldWhereARunSaysNothing) {
  const auto scenario = read(
      "title: T\n"
      "hosts: loopback\n"
      "defaults: {transport: cyclonedds, period: 20 ms, qos: {depth: 3}}\n"
      "runs:\n"
      "  - id: a\n"
      "  - {id: b, period: 5 ms, qos: {reliability: reliable}}\n");
  ASSERT_EQ(scenario.runs.size(), 2U);
  EXPECT_EQ(scenario.runs[0].task.client.period, 20ms);
  EXPECT_EQ(scenario.runs[1].task.client.period, 5ms);
  EXPECT_EQ(scenario.runs[1].task.config.qos.depth, 3) << "merged key by key";
  EXPECT_EQ(scenario.runs[1].task.config.qos.reliability, transport::Reliability::reliable);
  EXPECT_EQ(scenario.hosts.kind, Hosts::Kind::loopback);
}

TEST_F(ScenarioFile, ListsMultiply) {
  const std::string text =
      "runs:\n"
      "  - {id: a, transport: [udp, fastdds], payload: [1 B, 2 B]}\n"
      "  - {id: b, transport: udp, payload: 3 B}\n";
  EXPECT_THAT(words(read(text)),
              ElementsAre("a udp 1 1", "a udp 2 1", "a fastdds 1 1", "a fastdds 2 1", "b udp 3 1"));
  EXPECT_EQ(read(text).runs[1].variant, "payload 2 B");
}

TEST_F(ScenarioFile, RepetitionsAreInterleavedUnlessOrderIsSequential) {
  const std::string runs =
      "runs: [{id: a, transport: udp, payload: 1 B}, {id: b, transport: udp, payload: 2 B}]\n";
  EXPECT_THAT(words(read("repeat: 2\n" + runs)),
              ElementsAre("a udp 1 1", "b udp 2 1", "a udp 1 2", "b udp 2 2"));
  EXPECT_THAT(words(read("repeat: 2\norder: sequential\n" + runs)),
              ElementsAre("a udp 1 1", "a udp 1 2", "b udp 2 1", "b udp 2 2"));
}

TEST_F(ScenarioFile, SelectedValueReplacesTheFilesValue) {
  const std::string text = "defaults: {transport: udp, payload: [1 kB, 2 kB]}\nruns: [{id: a}]\n";
  Selection selection;
  selection.set = {{"payload", "300 B"}, {"kernel.ksoftirqd", "60"}};
  const auto scenario = read(text, selection);
  ASSERT_EQ(scenario.runs.size(), 1);
  EXPECT_EQ(scenario.runs[0].task.client.payload_bytes, 300);
  EXPECT_EQ(scenario.runs[0].kernel.at("ksoftirqd"), "60");
  selection.set = {{"kernel.no-such-key", "60"}};
  EXPECT_THROW(read(text, selection), scenario::Error);
  selection.set = {{"payload", "much"}};
  EXPECT_THROW(read(text, selection), scenario::Error);
}

TEST_F(ScenarioFile, SelectionNarrowsIt) {
  const std::string text =
      "runs: [{id: a, transport: [udp, fastdds], duration: 1 h}, {id: b, transport: udp}]\n";
  Selection selection;
  selection.only = {"a"};
  selection.transports = {"cyclonedds"};
  selection.duration = 2s;
  const auto scenario = read(text, selection);
  EXPECT_THAT(words(scenario), ElementsAre("a cyclonedds 500 1"));
  EXPECT_EQ(scenario.runs[0].task.client.duration, 2s);
  selection.only = {"c"};
  EXPECT_THAT(error(text, selection), HasSubstr(" has no run 'c'; there are: a, b"));
  selection.only = {"idel"};
  EXPECT_THAT(error("runs: [{id: idle, transport: udp}]\n", selection),
              HasSubstr(" has no run 'idel' (did you mean 'idle'?); there are: idle"));
}

TEST_F(ScenarioFile, FileWithoutSelectedRunIsLeftOut) {
  const auto other = path_.string() + ".other";
  std::ofstream(path_) << "runs: [{id: a, transport: udp}, {id: b, transport: udp}]\n";
  std::ofstream(other) << "repeat: 2\nruns: [{id: c, transport: udp}]\n";
  const std::vector<std::string> files = {path_, other};
  EXPECT_EQ(read_scenarios(files, {}).size(), 2U);
  Selection selection;
  selection.only = {"b"};
  const auto scenarios = read_scenarios(files, selection);
  ASSERT_EQ(scenarios.size(), 1U);
  EXPECT_THAT(words(scenarios[0]), ElementsAre("b udp 500 1"));
  selection.only = {"c", "a"};
  EXPECT_EQ(read_scenarios(files, selection).size(), 2U);
  selection.only = {"a", "d"};
  try {
    read_scenarios(files, selection);
    ADD_FAILURE() << "none of them has it";
  } catch (const scenario::Error& error) {
    EXPECT_STREQ(error.what(), "these 2 scenarios have no run 'd'; there are: a, b, c");
  }
  std::filesystem::remove(other);
}

TEST_F(ScenarioFile, ThePriorityOfTheApplicationIsTheLeastOfItsThreads) {
  const auto priority = [this](const std::string& realtime) {
    return application_priority(
        read("runs: [{id: a, transport: udp, realtime: " + realtime + "}]\n").runs[0]);
  };
  EXPECT_EQ(priority("on"), 80);
  EXPECT_EQ(priority("off"), 0);
  EXPECT_EQ(priority("{receive: {priority: 20}}"), 20);
  EXPECT_EQ(priority("{send: {policy: other}}"), 0);
  EXPECT_EQ(priority("{receive: {policy: other}}"), 0) << "not those of the thread that comes after";
  EXPECT_EQ(priority("{send: {policy: deadline}}"), 80) << "it comes before every priority";
}

TEST_F(ScenarioFile, RealtimeSettingsAreAPresetThatIsRefined) {
  const auto scenario = read(
      "defaults: {transport: udp, realtime: {priority: 90, send: {cpus: 0-1}}}\n"
      "runs: [{id: off, realtime: off}, {id: on}, {id: list, realtime: {priority: [70, 80]}}, "
      "{id: ms, realtime: {send: {policy: deadline}}}]\n");
  const auto& runs = scenario.runs;
  ASSERT_EQ(runs.size(), 5U);
  EXPECT_FALSE(runs[0].task.realtime.on);
  EXPECT_TRUE(runs[0].task.realtime.threads.empty());
  const auto& on = runs[1].task.realtime;
  EXPECT_TRUE(on.on && on.lock_memory);
  EXPECT_EQ(on.threads.at("receive").priority, 90);
  EXPECT_EQ(on.threads.at("discovery").priority, 70);
  EXPECT_THAT(on.threads.at("send").cpus, ElementsAre(0, 1));
  EXPECT_EQ(runs[2].task.realtime.threads.at("send").priority, 70);
  EXPECT_EQ(runs[3].task.realtime.threads.at("send").priority, 80);
  const auto& deadline = runs[4].task.realtime.threads.at("send");
  EXPECT_EQ(deadline.policy, realtime::Policy::deadline);
  EXPECT_EQ(deadline.period, 10ms);
}

TEST_F(ScenarioFile, ComponentMayHaveItsOwnTransport) {
  const auto scenario = read(
      "runs: [{id: a, transport: cyclonedds, options: {config: c}, component: {transport: ros2, "
      "options: {rmw: [w, x]}}}]\n");
  ASSERT_EQ(scenario.runs.size(), 2U);
  EXPECT_EQ(scenario.runs[1].task.transport, "cyclonedds");
  EXPECT_EQ(scenario.runs[1].component_transport, "ros2");
  EXPECT_THAT(scenario.runs[1].component_options, ElementsAre(testing::Pair("rmw", "x")));
  EXPECT_THAT(scenario.runs[1].task.config.options, ElementsAre(testing::Pair("config", "c")));
  EXPECT_EQ(scenario.runs[1].variant, "component.options.rmw x");
}

TEST_F(ScenarioFile, GatesDoNotMultiplyRunsAndAreCheckedWhenRead) {
  const auto scenario = read(
      "defaults: {transport: [udp, fastdds], require: late <= 0}\n"
      "runs:\n"
      "  - id: a\n"
      "  - {id: b, require: [p99.9 <= 2 ms, lost <= 0.1%]}\n");
  ASSERT_EQ(scenario.runs.size(), 4U);
  EXPECT_THAT(scenario.runs[1].require, testing::ElementsAre("late <= 0"));
  EXPECT_THAT(scenario.runs[3].require, testing::ElementsAre("p99.9 <= 2 ms", "lost <= 0.1%"));
  EXPECT_EQ(asked(scenario.runs[3], scenario.hosts).at("require").size(), 2U);
  const auto of = [](const char* gates) {
    return std::string("runs: [{id: a, transport: udp, require: ") + gates + "}]\n";
  };
  EXPECT_THAT(error(of("[late <= 0, p98 <= 2 ms]")),
              HasSubstr(":1:53: require: 'p98 <= 2 ms', column 1: 'p98'"));
  EXPECT_THAT(error(of("late > 0")), HasSubstr("column 6: expected '<='"));
  EXPECT_THAT(error(of("p99 <= +10%")), HasSubstr("column 8: "));
  EXPECT_THAT(error(of("[[late <= 0]]")), HasSubstr("a value is needed"));
  EXPECT_THAT(error(of("{late: 0}")), HasSubstr("require: a list of limits is needed"));
}

TEST_F(ScenarioFile, HostsHaveTheirConnectionAndPrefix) {
  const auto hosts = read(
                         "hosts:\n"
                         "  controller: {command-prefix: [ip, netns, exec, left], interface: eth1}\n"
                         "  component: {ssh: me@robot, host-prefix: [sudo, -n], command-prefix: [], program: "
                         "/opt/ontime/bin/ontime, "
                         "interface: eth2, address: 10.0.0.2}\n"
                         "runs: [{id: a, transport: udp}]\n")
                         .hosts;
  EXPECT_EQ(hosts.kind, Hosts::Kind::stated);
  EXPECT_THAT(hosts.controller.host_prefix, testing::IsEmpty());
  EXPECT_THAT(hosts.controller.command_prefix, ElementsAre("ip", "netns", "exec", "left"));
  EXPECT_EQ(hosts.controller.program, "");
  EXPECT_EQ(hosts.controller.ssh, "");
  EXPECT_EQ(hosts.at("component").ssh, "me@robot");
  EXPECT_THAT(hosts.at("component").host_prefix, ElementsAre("sudo", "-n"));
  EXPECT_THAT(hosts.at("component").command_prefix, testing::IsEmpty());
  EXPECT_EQ(hosts.at("component").program, "/opt/ontime/bin/ontime");
  EXPECT_EQ(hosts.at("component").interface, "eth2");
  EXPECT_EQ(hosts.at("component").address, "10.0.0.2");
}

TEST_F(ScenarioFile, InvalidHostsAreRefusedWithTheirPlace) {
  const auto with = [this](const std::string& host) {
    return error("hosts: {component: {address: 1.2.3.4, " + host + "}}\nruns: [{id: a, transport: udp}]\n");
  };
  EXPECT_THAT(with("prefix: ip netns exec robot"),
              testing::AllOf(HasSubstr(":1:39: prefix"), HasSubstr("ssh: robot"),
                             HasSubstr("command-prefix: [ip, netns, exec, robot]")));
  EXPECT_THAT(with("host-prefix: ssh robot"),
              testing::AllOf(HasSubstr("host-prefix: a list of words"), HasSubstr("[sudo, -n]"),
                             HasSubstr("as a program")));
  for (const auto* odd : {"-oProxyCommand=x", "me at robot", "\"robot\\n\""})
    EXPECT_THAT(with(std::string("ssh: ") + odd), HasSubstr("ssh destination")) << odd;
  EXPECT_THAT(with("host-prefix: ssh"), HasSubstr("host-prefix: a list of words"));
  for (const auto* address : {"fd00:9::2", "::1", "'[fd00:9::2]:7900'", "fe80::1%eth0"})
    EXPECT_THAT(error("hosts: {component: {address: " + std::string(address) +
                      "}}\nruns: [{id: a, transport: udp}]\n"),
                testing::AllOf(HasSubstr(":1:30: address: "), HasSubstr("IPv4")))
        << address;
  EXPECT_THAT(with("command-prefix: [ip, '']"), HasSubstr("command-prefix: a value is needed"));
  EXPECT_THAT(with("command-prefix: [ip, [netns]]"), HasSubstr("command-prefix: a value is needed"));
  EXPECT_THAT(with("program: []"), HasSubstr("program: a value is needed"));
  EXPECT_THAT(with("interface: a-name-too-long-for-linux"),
              HasSubstr("interface: 'a-name-too-long-for-linux'"));
  EXPECT_THAT(with("interface: ../x"), HasSubstr("interface: '../x'"));
  EXPECT_THAT(with("interface: wan=1"), HasSubstr("interface: 'wan=1'")) << "as tc and nft have it";
  EXPECT_THAT(with("wat: x"), HasSubstr("allowed keys: ssh, host-prefix, command-prefix, program"));
  EXPECT_THAT(with("host-prefix: [a], host-prefix: [b]"), HasSubstr("'host-prefix' occurs twice"));
}

// The domain of ROS 2, for the time of a test. NOLINTBEGIN(concurrency-mt-unsafe): one thread
class RosDomain {
 public:
  explicit RosDomain(const char* id) { setenv("ROS_DOMAIN_ID", id, 1); }
  ~RosDomain() { unsetenv("ROS_DOMAIN_ID"); }
  RosDomain(const RosDomain&) = delete;
  RosDomain& operator=(const RosDomain&) = delete;
};
// NOLINTEND(concurrency-mt-unsafe)

TEST_F(ScenarioFile, TheDomainIsThatOfRosUnlessStated) {
  const std::string text =
      "runs: [{id: a, transport: [udp, ros2]}, {id: b, transport: fastdds, domain: 7}]\n";
  const auto domains = [&] {
    std::vector<int> found;
    for (const auto& run : read(text).runs) found.push_back(run.task.config.domain);
    return found;
  };
  EXPECT_THAT(domains(), ElementsAre(0, 0, 7));
  {
    const RosDomain domain("42");
    EXPECT_THAT(domains(), ElementsAre(42, 42, 7));
  }
  {
    const RosDomain domain("");  // as ROS 2 takes it
    EXPECT_THAT(domains(), ElementsAre(0, 0, 7));
  }
  for (const auto* wrong : {"forty-two", "233", "-1", "1.5", "99999999999999999999"}) {
    const RosDomain domain(wrong);
    EXPECT_THAT(error(text), testing::AllOf(HasSubstr(":1:8: run 'a': ROS_DOMAIN_ID: '" + std::string(wrong)),
                                            HasSubstr("0 to 232")));
    EXPECT_EQ(error("runs: [{id: b, transport: fastdds, domain: 7}]\n"), "no error") << "overruled";
  }
}

TEST_F(ScenarioFile, TopicsAreNamedAsRosNamesThem) {
  const auto topics = [this](const std::string& keys) {
    const auto config = read("runs: [{id: a, transport: udp" + keys + "}]\n").runs.at(0).task.config;
    return config.ping_topic + " " + config.pong_topic;
  };
  EXPECT_EQ(topics(""), "/ping /pong");
  EXPECT_EQ(topics(", namespace: /robot"), "/robot/ping /robot/pong");
  EXPECT_EQ(topics(", namespace: robot/arm_2"), "/robot/arm_2/ping /robot/arm_2/pong")
      << "as rclcpp takes it";
  EXPECT_EQ(topics(", namespace: /"), "/ping /pong");
  EXPECT_EQ(topics(", namespace: /robot, topics: {ping: there, pong: /back/again}"),
            "/robot/there /back/again");
}

TEST_F(ScenarioFile, NamesThatRosRefusesAreRefused) {
  const auto with = [this](const std::string& keys) {
    return error("runs: [{id: a, transport: udp, " + keys + "}]\n");
  };
  for (const auto* name :
       {"1ping", "a/2b", "/ping/", "a//b", "/", "pi ng", "pi-ng", "~/ping", "{node}/ping", "pïng", "a.b"}) {
    EXPECT_THAT(with("topics: {ping: '" + std::string(name) + "'}"),
                testing::AllOf(HasSubstr("topics.ping: '" + std::string(name) + "'"), HasSubstr("ROS 2")));
    if (std::string_view(name) == "/") continue;
    EXPECT_THAT(with("namespace: '" + std::string(name) + "'"),
                HasSubstr("namespace: '" + std::string(name) + "'"));
  }
  const std::string longest(246, 'a');
  EXPECT_EQ(with("topics: {ping: " + longest + "}"), "no error");
  EXPECT_THAT(with("topics: {ping: " + longest + "a}"), HasSubstr("longer than 247"));
  EXPECT_THAT(with("namespace: b, topics: {ping: " + longest + "}"), HasSubstr("longer than 247"));
  EXPECT_THAT(with("topics: {ping: same, pong: same}"), HasSubstr("both /same"));
  EXPECT_THAT(with("namespace: /robot, topics: {ping: x, pong: /robot/x}"), HasSubstr("both /robot/x"));
}

TEST_F(ScenarioFile, ALayerMayBeChosenWithoutTheOneBelow) {
  Selection selection;
  selection.only = {"upper"};
  const auto scenario = read(
      "runs: [{id: lower, transport: udp}, {id: upper, transport: fastdds, baseline: lower}]\n", selection);
  ASSERT_EQ(scenario.runs.size(), 1U);
  EXPECT_EQ(scenario.runs[0].adds_to, "lower");
}

TEST_F(ScenarioFile, ABaselineOfItselfOrInACircleIsRefusedAtItsPlace) {
  EXPECT_THAT(error("runs: [{id: a, transport: udp, baseline: a}]\n"),
              HasSubstr(":1:42: baseline: the baselines form a circle: a → a"));
  const auto circle =
      "runs:\n"
      "- {id: a, transport: udp, baseline: b}\n"
      "- {id: b, transport: udp, baseline: c}\n"
      "- {id: c, transport: udp, baseline: b}\n";
  EXPECT_THAT(error(circle), HasSubstr(":3:37: baseline: the baselines form a circle: b → c → b"));
  Selection selection;
  selection.only = {"a"};
  EXPECT_THAT(error(circle, selection), HasSubstr("b → c → b"));
  EXPECT_THAT(error("runs: [{id: a, transport: udp, baseline: [b, c]}, {id: b, transport: udp},\n"
                    "{id: c, transport: udp, baseline: [b, a]}]\n"),
              HasSubstr(":1:46: baseline: the baselines form a circle: a → c → a"));
}

TEST_F(ScenarioFile, ABaselineThatIsNoRunIsRefusedAtItsPlace) {
  const auto two = [](const std::string& baseline) {
    return "runs: [{id: plain, transport: udp}, {id: a, transport: udp, baseline: " + baseline + "}]\n";
  };
  EXPECT_THAT(error(two("plian")),
              HasSubstr(":1:71: baseline: no run has the id 'plian' (did you mean 'plain'?)"));
  EXPECT_THAT(error(two("zzz")), HasSubstr("the id 'zzz'; there are: a, plain"));
  EXPECT_THAT(error(two("[plain, zzz]")), HasSubstr(":1:79: baseline: no run has the id 'zzz'"));
  Selection selection;
  selection.only = {"plain"};
  EXPECT_THAT(error(two("zzz"), selection), HasSubstr("'zzz'"));
  EXPECT_EQ(error(two("[plain]")), "no error");
}

TEST_F(ScenarioFile, DuplicateValuesAreRefused) {
  EXPECT_THAT(error("runs: [{id: a, transport: udp, payload: [1 B, 2 B, 1 B]}]\n"),
              HasSubstr(":1:52: payload: '1 B' occurs twice"));
  EXPECT_THAT(error("runs: [{id: a, transport: udp, period: [10 ms, 0.01 s]}]\n"),
              HasSubstr(":1:48: period: '10 ms' and '0.01 s' are one value"));
  for (const auto* twice :
       {"realtime: [on, On]", "realtime.lock-memory: [on, yes]", "realtime.priority: [80, 080]",
        "realtime.cpus: [0-1, '0,1']", "kernel.irq-threads: ['90', '090']", "explain: [off, no]",
        "domain: [1, 01]", "link.cut: [1 s for 1 s, 1 s for 1000 ms]"})
    EXPECT_THAT(error(fmt::format("runs: [{{id: a, transport: udp, {}}}]\n", twice)),
                HasSubstr("are one value"))
        << twice;
  for (const auto* apart :
       {"domain: [1, 2]", "topics.ping: [a, b]", "namespace: [/a, /b]", "realtime.priority: [80, 81]",
        "link.cut: [1 s for 1 s, 2 s for 1 s]", "kernel.irq-threads: [as-is, 90]"})
    EXPECT_EQ(error(fmt::format("runs: [{{id: a, transport: udp, {}}}]\n", apart)), "no error") << apart;
  Selection selection;
  selection.transports = {"udp", "udp"};
  EXPECT_THAT(error("runs: [{id: a}]\n", selection), HasSubstr("transport: 'udp' occurs twice"));
  EXPECT_THAT(error("defaults: {id: a}\nruns: [{transport: udp}]\n"), HasSubstr(":1:16: id: "));
}

TEST_F(ScenarioFile, DeadlineBeyondTimeoutIsRefusedWithUnits) {
  EXPECT_THAT(error("runs: [{id: a, transport: udp, deadline: 1 s, timeout: 500 ms}]\n"),
              testing::AllOf(HasSubstr("deadline (1 s)"), HasSubstr("timeout (500 ms)")));
}

// By it a run over one link is told from a run over another: in tables, and by its key.
TEST_F(ScenarioFile, RecordHoldsTheInterfaces) {
  const std::string runs = "runs: [{id: a, transport: udp}]\n";
  const auto link_of = [&](const std::string& text) {
    const auto scenario = read(text);
    const auto record = asked(scenario.at(0), scenario.hosts);
    return json{record.at("interface"), record.at("component_interface")};
  };
  EXPECT_EQ(link_of(runs), json({nullptr, nullptr}));
  EXPECT_EQ(
      link_of("hosts: {controller: {interface: eth1}, component: {interface: eth2, address: 10.0.0.2}}\n" +
              runs),
      json({"eth1", "eth2"}));
  campaign::Run run;
  run.task.config.interface = "wlan0";
  EXPECT_EQ(asked(run, {}).at("interface"), "wlan0") << "by a flag";
}

TEST(Scenarios, ShippedScenariosAreRead) {
  const std::filesystem::path folder(ONTIME_SCENARIOS);
  int files = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    if (entry.path().extension() != ".yaml") continue;
    ++files;
    EXPECT_NO_THROW(read_scenario(entry.path(), {})) << entry.path();
  }
  EXPECT_GE(files, 2);
}

}  // namespace
}  // namespace ontime::campaign

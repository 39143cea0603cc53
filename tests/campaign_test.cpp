// SPDX-License-Identifier: Apache-2.0
#include "campaign/campaign.hpp"

#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <random>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

namespace ontime::campaign {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;
using testing::ElementsAre;
using testing::HasSubstr;

TEST(Quantity, IsANumberWithAUnit) {
  EXPECT_EQ(duration_of("10 ms"), 10ms);
  EXPECT_EQ(duration_of("10ms"), 10ms);
  EXPECT_EQ(duration_of("0.5 s"), 500ms);
  EXPECT_EQ(duration_of("250 µs"), 250us);
  EXPECT_EQ(duration_of("250 us"), 250us);
  EXPECT_EQ(duration_of("12 h"), 12h);
  EXPECT_EQ(bytes_of("500 B"), 500U);
  EXPECT_EQ(bytes_of("32 KiB"), 32768U);
  EXPECT_EQ(bytes_of("1 MB"), 1'000'000U);
}

TEST(Quantity, SaysWhatIsWrong) {
  for (const auto* text :
       {"",        "ten",     "ms",         "10",      "10 parsec", "10 ms more",    "nan s",
        "-nan s",  "inf s",   "infinity s", "1e300 s", "1e-5000 s", "99999999999 h", "-99999999999 h",
        "0x10 ms", "0x1p3 s", "+5 ms",      "- 5 ms",  "1,5 ms",    " 10 ms",        "10 ms ",
        "10\tms",  "10 MS",   "1_000 ms",   "10 ms 5", "١٠ ms"})
    EXPECT_THROW(duration_of(text), std::invalid_argument) << text;
  for (const auto* text : {"500", "-1 B", "0.5 B", "1e30 B", "99999999999 GiB", "nan B", "inf kB", "0x10 B",
                           "1 kb", "1 K", "+1 B", "1 B/s"})
    EXPECT_THROW(bytes_of(text), std::invalid_argument) << text;
  try {
    duration_of("10");
    FAIL();
  } catch (const std::invalid_argument& error) {
    EXPECT_THAT(error.what(), HasSubstr("10 ms"));
  }
}

// Whatever is written in whole units, or in thousandths of the next, is what is read: nothing is rounded
// away.
TEST(Quantity, IsReadExactly) {
  const std::vector<std::pair<std::string, std::int64_t>> times{{"ns", 1},
                                                                {"us", 1'000},
                                                                {"µs", 1'000},
                                                                {"ms", 1'000'000},
                                                                {"s", 1'000'000'000},
                                                                {"min", 60'000'000'000},
                                                                {"h", 3'600'000'000'000}};
  const std::vector<std::pair<std::string, std::uint64_t>> sizes{
      {"B", 1},           {"kB", 1'000},         {"KiB", 1U << 10U}, {"MB", 1'000'000},
      {"MiB", 1U << 20U}, {"GB", 1'000'000'000}, {"GiB", 1U << 30U}};
  constexpr std::int64_t most = 9'000'000'000'000'000'000;
  std::mt19937_64 random(5);
  // Of all magnitudes alike.
  const auto up_to = [&](std::int64_t limit) {
    return static_cast<std::int64_t>(random() >> (1 + random() % 62)) % (limit + 1);
  };
  for (int round = 0; round < 2000; ++round) {
    const auto blank = random() % 2 == 0 ? " " : "";
    for (const auto& [unit, factor] : times) {
      const auto count = up_to(most / factor) * (random() % 2 == 0 ? 1 : -1);
      const auto text = std::to_string(count) + blank + unit;
      ASSERT_EQ(duration_of(text).count(), count * factor) << text;
    }
    for (const auto& [unit, factor] : sizes) {
      const auto count = static_cast<std::uint64_t>(up_to(most / static_cast<std::int64_t>(factor)));
      const auto text = std::to_string(count) + blank + unit;
      ASSERT_EQ(bytes_of(text), count * factor) << text;
    }
    const auto thousandths = up_to(1'000'000'000);
    const auto digits = std::to_string(1000 + thousandths % 1000).substr(1);
    const auto text = std::to_string(thousandths / 1000) + "." + digits + " s";
    ASSERT_EQ(duration_of(text).count(), thousandths * 1'000'000) << text;
  }
}

TEST(Number, IsWholeAndWithinItsBounds) {
  EXPECT_EQ(number_of("7", 1, 9), 7);
  EXPECT_EQ(number_of("-7", -9, 9), -7);
  EXPECT_EQ(number_of("9223372036854775807", 0, std::numeric_limits<std::int64_t>::max()),
            std::numeric_limits<std::int64_t>::max());
  for (const auto* text : {"", "0", "10", "seven", "7.0", "7e0", "0x7", "+7", " 7", "7 ", "7 ms", "nan",
                           "inf", "99999999999999999999", "-99999999999999999999"})
    EXPECT_THROW(number_of(text, 1, 9), std::invalid_argument) << text;
}

class ScenarioFile : public testing::Test {
 protected:
  ScenarioFile()
      : path_(std::filesystem::temp_directory_path() /
              ("ontime-scenario-" + std::to_string(getpid()) + ".yaml")) {
    unsetenv("ROS_DOMAIN_ID");  // the shell's own; NOLINT(concurrency-mt-unsafe): one thread
  }
  ~ScenarioFile() override { std::filesystem::remove(path_); }

  Scenario read(const std::string& text, const Selection& selection = {}) {
    std::ofstream(path_) << text;
    return read_scenario(path_, selection);
  }
  // The message, without the file's name.
  std::string error(const std::string& text, const Selection& selection = {}) {
    try {
      read(text, selection);
    } catch (const Error& error) {
      EXPECT_EQ(error.exit, 2);
      const std::string message = error.what();
      EXPECT_THAT(message, HasSubstr(path_.string()));
      return message.substr(message.find(path_.string()) + path_.string().size());
    }
    return "no error";
  }
  const std::filesystem::path path_;
};

std::vector<std::string> words(const Scenario& scenario) {
  std::vector<std::string> result;
  for (std::size_t i = 0; i < scenario.size(); ++i) {
    const auto run = scenario.at(i);
    result.push_back(run.id + " " + run.task.transport + " " + std::to_string(run.task.client.payload_bytes) +
                     " " + std::to_string(run.repetition));
  }
  return result;
}

TEST_F(ScenarioFile, DefaultsHoldWhereARunSaysNothing) {
  const auto scenario = read(
      "title: T\n"
      "hosts: loopback\n"
      "defaults: {transport: udp, period: 20 ms, qos: {depth: 3}}\n"
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

TEST_F(ScenarioFile, RepetitionsAreInterleavedUnlessSaidOtherwise) {
  const std::string runs =
      "runs: [{id: a, transport: udp, payload: 1 B}, {id: b, transport: udp, payload: 2 B}]\n";
  EXPECT_THAT(words(read("repeat: 2\n" + runs)),
              ElementsAre("a udp 1 1", "b udp 2 1", "a udp 1 2", "b udp 2 2"));
  EXPECT_THAT(words(read("repeat: 2\norder: sequential\n" + runs)),
              ElementsAre("a udp 1 1", "a udp 1 2", "b udp 2 1", "b udp 2 2"));
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
  EXPECT_THAT(error(text, selection), HasSubstr("no run 'c'; it has: a, b"));
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

TEST_F(ScenarioFile, TheAnsweringEndMayBeAnother) {
  const auto scenario = read(
      "runs: [{id: a, transport: udp, options: {port: 1}, component: {transport: [fastdds, ros2], options: "
      "{rmw: x}}}]\n");
  ASSERT_EQ(scenario.runs.size(), 2U);
  EXPECT_EQ(scenario.runs[1].task.transport, "udp");
  EXPECT_EQ(scenario.runs[1].component_transport, "ros2");
  EXPECT_THAT(scenario.runs[1].component_options, ElementsAre(testing::Pair("rmw", "x")));
  EXPECT_THAT(scenario.runs[1].task.config.options, ElementsAre(testing::Pair("port", "1")));
  EXPECT_EQ(scenario.runs[1].variant, "component.transport ros2");
}

TEST_F(ScenarioFile, WhatIsRequiredDoesNotMultiplyAndIsCheckedAsItIsRead) {
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
  EXPECT_THAT(error(of("late > 0")), HasSubstr("column 6: here stands '>'"));
  EXPECT_THAT(error(of("p99 <= +10%")), HasSubstr("against another run"));
  EXPECT_THAT(error(of("[[late <= 0]]")), HasSubstr("a value is needed"));
  EXPECT_THAT(error(of("{late: 0}")), HasSubstr("unknown key 'require.late'"));
}

TEST_F(ScenarioFile, ErrorsSayWhere) {
  EXPECT_THAT(error("runs:\n  - id: a\n    transport: udp\n    perid: 10 ms\n"),
              testing::AllOf(HasSubstr(":4:5: unknown key 'perid'"), HasSubstr("period")));
  EXPECT_THAT(error("runs:\n  - {id: a, transport: udp, period: 10}\n"),
              HasSubstr(":2:37: period: '10' has no unit"));
  EXPECT_THAT(error("runs:\n  - {id: a, transport: udp, period: 0 ms}\n"), HasSubstr("period: '0 ms'"));
  EXPECT_THAT(error("runs:\n  - {id: a, transport: udp, period: -5 ms}\n"), HasSubstr("period: '-5 ms'"));
  EXPECT_THAT(error("runs:\n  - {id: a, transport: udp, qos: {depth: 0}}\n"), HasSubstr("qos.depth: '0'"));
  EXPECT_THAT(error("runs:\n  - {id: a, transport: udp, payload: [1 B, 2 Q]}\n"),
              HasSubstr(":2:44: payload: '2 Q'"));
  EXPECT_THAT(error("runs:\n  - {id: a, transport: udp}\n  - {id: a, transport: udp}\n"),
              HasSubstr("another run with id 'a'"));
  EXPECT_THAT(error("runs:\n  - {id: a, transport: udp, transport: fastdds}\n"),
              HasSubstr("'transport' is there twice"));
  EXPECT_THAT(error("runs: [\n"), HasSubstr(":2:1:"));
  EXPECT_THAT(error("runs: []\n"), HasSubstr("a list of runs is needed"));
  EXPECT_THAT(error("title: x\n"), HasSubstr("a list of runs is needed"));
  EXPECT_THAT(error("- a\n"), HasSubstr("not a scenario"));
  EXPECT_THAT(error(""), HasSubstr("not a scenario"));
  EXPECT_THAT(error("wat: 1\nruns: [{id: a, transport: udp}]\n"), HasSubstr(":1:1: unknown key 'wat'"));
  EXPECT_THAT(error("runs: [{transport: udp}]\n"), HasSubstr("a run needs an id"));
  EXPECT_THAT(error("runs: [{id: a}]\n"), HasSubstr("no transport"));
  EXPECT_THAT(error("repeat: 0\nruns: [{id: a, transport: udp}]\n"), HasSubstr(":1:9: repeat"));
  EXPECT_THAT(error("order: random\nruns: [{id: a, transport: udp}]\n"), HasSubstr(":1:8: order"));
  EXPECT_THAT(error("hosts: mars\nruns: [{id: a, transport: udp}]\n"), HasSubstr(":1:8: hosts"));
  EXPECT_THAT(error("runs: [{id: a, transport: udp, deadline: 1 s}]\n"), HasSubstr("deadline"));
  EXPECT_THAT(error("runs: [{id: a, transport: udp, realtime: {policy: other, priority: 5}}]\n"),
              HasSubstr("priority needs policy"));
  EXPECT_THAT(error("runs: [{id: a, transport: udp, period: {a: 1}}]\n"),
              HasSubstr("unknown key 'period.a'"));
  EXPECT_THAT(error("runs: [{id: a, transport: udp, period: }]\n"), HasSubstr("a value is needed"));
  EXPECT_THROW(read_scenario("/no/such/file.yaml", {}), Error);
  EXPECT_THROW(read_scenario("/", {}), Error);
}

TEST_F(ScenarioFile, QuantitiesThatMeanNothingAreRefused) {
  const auto with = [](const std::string& key) { return "runs: [{id: a, transport: udp, " + key + "}]\n"; };
  for (const auto* key : {"duration: 0 s",
                          "duration: -1 s",
                          "duration: 1001 h",
                          "duration: 99999999999 h",
                          "period: 2 h",
                          "timeout: 61 min",
                          "deadline: -1 ms",
                          "payload: 2 GiB",
                          "payload: -1 B",
                          "payload: 99999999 GiB",
                          "warm-up: 0",
                          "warm-up: -1",
                          "warm-up: 1.5",
                          "domain: 233",
                          "domain: -1",
                          "domain: 0x1",
                          "qos: {depth: 99999999999999999999}",
                          "realtime: {cpu-latency: -5 us}",
                          "realtime: {cpu-latency: 1500 ns}",
                          "realtime: {cpu-latency: 1 h}",
                          "realtime: {cpus: 0-99999999999}",
                          "realtime: {priority: 100}",
                          "load: {controller: {cpu: -1}}",
                          "load: {controller: {cpu: nan}}",
                          "load: {controller: {vm-bytes: 0 B}}",
                          "load: {component: {hdd-bytes: -1 B}}",
                          "traffic: {rate: 80}",
                          "traffic: {rate: 0 Mbit/s}",
                          "traffic: {rate: 80 Mbps}",
                          "traffic: {rate: 1 Mbit/s, datagram: 15 B}",
                          "traffic: {rate: 1 Mbit/s, datagram: 64 KiB}",
                          "traffic: {rate: 1 Mbit/s, direction: up}",
                          "traffic: {rate: 1 Mbit/s, priority: 0}",
                          "traffic: {direction: to-component}",
                          "link: {loss: 101 %}",
                          "link: {loss: 0 %}",
                          "link: {loss: 0.1}",
                          "link: {jitter: 1 ms}",
                          "link: {reorder: 5 %}",
                          "link: {delay: 1 ms, jitter: 2 ms}",
                          "link: {delay: 100 ns}",
                          "link: {cut: 5 s}",
                          "link: {cut: 5 s for 0 s}",
                          "link: {cut: 5 s for 1 us}",
                          "link: {cut: 10 s for 1 s}"})
    EXPECT_THAT(error(with(key)), testing::StartsWith(":1:")) << key;
  for (const auto* key : {"duration: 1000 h", "period: 1 h", "payload: 1 GiB", "payload: 0 B", "domain: 232",
                          "realtime: {cpu-latency: any}", "realtime: {cpu-latency: 2 ms}"})
    EXPECT_EQ(error(with(key)), "no error") << key;
}

TEST_F(ScenarioFile, TrafficIsSaid) {
  const auto runs = read(
                        "defaults: {transport: udp, traffic: {rate: 80 Mbit/s}}\n"
                        "runs:\n"
                        "  - id: a\n"
                        "  - {id: b, traffic: {rate: 1.5 Mbit/s, direction: to-controller, datagram: 200 B, "
                        "priority: 5}}\n")
                        .runs;
  EXPECT_EQ(runs.at(0).traffic.bits_per_s, 80'000'000U);
  EXPECT_EQ(asked(runs.at(0), {}).at("traffic").at("direction"), "both");
  EXPECT_EQ(runs.at(1).traffic, (Traffic{Traffic::Direction::to_controller, 1'500'000, 200, 5}));
  EXPECT_EQ(asked(campaign::Run{}, {}).at("traffic"), nullptr) << "keys of earlier runs stay as they were";
}

TEST_F(ScenarioFile, FaultsOfTheLinkAreSaid) {
  const auto run =
      read(
          "runs: [{id: a, transport: udp, link: {loss: 1%, duplicate: 0.5 %, delay: 2 ms, jitter: 500 us, "
          "reorder: 25 %, cut: 5 s for 500 ms}}]\n")
          .runs.at(0);
  EXPECT_EQ(run.faults, (background::Faults{0.01, 0.005, 2ms, 500us, 0.25, true}));
  EXPECT_EQ(run.cut->at, 5s);
  EXPECT_EQ(run.cut->length, 500ms);
  EXPECT_EQ(asked(run, {}).at("link").at("cut").at("for_ms"), 500);
  EXPECT_EQ(asked(campaign::Run{}, {}).at("link"), nullptr) << "keys of earlier runs stay as they were";
}

TEST_F(ScenarioFile, HostsSayHowTheyAreReachedAndWhereTheEndLives) {
  const auto hosts =
      read(
          "hosts:\n"
          "  controller: {place: [ip, netns, exec, left], interface: eth1}\n"
          "  component: {ssh: me@robot, reach: [sudo, -n], place: [], program: /opt/ontime/bin/ontime, "
          "interface: eth2, address: 10.0.0.2}\n"
          "runs: [{id: a, transport: udp}]\n")
          .hosts;
  EXPECT_EQ(hosts.kind, Hosts::Kind::stated);
  EXPECT_THAT(hosts.controller.reach, testing::IsEmpty());
  EXPECT_THAT(hosts.controller.place, ElementsAre("ip", "netns", "exec", "left"));
  EXPECT_EQ(hosts.controller.program, "");
  EXPECT_EQ(hosts.controller.ssh, "");
  EXPECT_EQ(hosts.component.ssh, "me@robot");
  EXPECT_THAT(hosts.component.reach, ElementsAre("sudo", "-n"));
  EXPECT_THAT(hosts.component.place, testing::IsEmpty());
  EXPECT_EQ(hosts.component.program, "/opt/ontime/bin/ontime");
  EXPECT_EQ(hosts.component.interface, "eth2");
  EXPECT_EQ(hosts.component.address, "10.0.0.2");
}

TEST_F(ScenarioFile, HostsAreRefusedInWords) {
  const auto with = [this](const std::string& host) {
    return error("hosts: {component: {address: 1.2.3.4, " + host + "}}\nruns: [{id: a, transport: udp}]\n");
  };
  EXPECT_THAT(with("prefix: ip netns exec robot"),
              testing::AllOf(HasSubstr(":1:39: prefix"), HasSubstr("ssh: robot"),
                             HasSubstr("place: [ip, netns, exec, robot]")));
  EXPECT_THAT(with("reach: ssh robot"), testing::AllOf(HasSubstr("reach: a list of words"),
                                                       HasSubstr("[sudo, -n]"), HasSubstr("as a program")));
  for (const auto* odd : {"-oProxyCommand=x", "me at robot", "\"robot\\n\""})
    EXPECT_THAT(with(std::string("ssh: ") + odd), HasSubstr("is nothing that ssh connects to")) << odd;
  EXPECT_THAT(with("reach: ssh"), HasSubstr("reach: a list of words"));
  EXPECT_THAT(with("place: [ip, '']"), HasSubstr("place: a value is needed"));
  EXPECT_THAT(with("place: [ip, [netns]]"), HasSubstr("place: a value is needed"));
  EXPECT_THAT(with("program: []"), HasSubstr("program: a value is needed"));
  EXPECT_THAT(with("interface: a-name-too-long-for-linux"),
              HasSubstr("interface: 'a-name-too-long-for-linux'"));
  EXPECT_THAT(with("interface: ../x"), HasSubstr("interface: '../x'"));
  EXPECT_THAT(with("wat: x"), HasSubstr("a host has ssh, reach, place, program, interface, address"));
  EXPECT_THAT(with("reach: [a], reach: [b]"), HasSubstr("'reach' is there twice"));
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
      "runs: [{id: lower, transport: udp}, {id: upper, transport: fastdds, adds-to: lower}]\n", selection);
  ASSERT_EQ(scenario.runs.size(), 1U);
  EXPECT_EQ(scenario.runs[0].adds_to, "lower");
}

TEST_F(ScenarioFile, TheSameIsNotMeasuredTwiceUnderOneName) {
  EXPECT_THAT(error("runs: [{id: a, transport: udp, payload: [1 B, 2 B, 1 B]}]\n"),
              HasSubstr(":1:52: payload: '1 B' is there twice"));
  Selection selection;
  selection.transports = {"udp", "udp"};
  EXPECT_THAT(error("runs: [{id: a}]\n", selection), HasSubstr("transport: 'udp' is there twice"));
  EXPECT_THAT(error("defaults: {id: a}\nruns: [{transport: udp}]\n"),
              HasSubstr(":1:16: id: each run has one of its own"));
}

TEST_F(ScenarioFile, AliasesThatNeverEndAreRefused) {
  EXPECT_THAT(error("defaults: &a {b: *a}\nruns: [{id: a, transport: udp}]\n"),
              HasSubstr(":1:18: this alias stands within what it stands for"));
  EXPECT_THAT(error("runs: &r [{id: a, transport: udp}, *r]\n"), HasSubstr(":1:36: this alias"));
  EXPECT_THAT(error("hosts: &h {controller: {a: [*h]}}\nruns: [{id: a, transport: udp}]\n"),
              HasSubstr(":1:29: this alias"));
  EXPECT_THAT(error("? &a [*a]\n: 1\n"), HasSubstr(":1:7: this alias"));
  // The name may be given anew: this one ends.
  EXPECT_EQ(error("defaults: {transport: &a udp}\nruns: [{id: &a x, title: *a}]\n"), "no error");
}

TEST_F(ScenarioFile, AliasesDoNotMultiplyWithoutBound) {
  std::string laughs = "defaults:\n  options: {a0: &a0 [x, x, x, x, x, x, x, x, x, x]";
  for (int i = 1; i < 10; ++i) {
    laughs += fmt::format(", a{0}: &a{0} [", i);
    for (int j = 0; j < 10; ++j) laughs += fmt::format("{}*a{}", j == 0 ? "" : ", ", i - 1);
    laughs += "]";
  }
  EXPECT_THAT(error(laughs + "}\nruns: [{id: a, transport: udp}]\n"),
              testing::AllOf(HasSubstr(":2:"), HasSubstr("more than 100000 keys and values")));
  std::string many = "runs:\n  - {id: a, transport: [";
  for (int i = 0; i < 100'001; ++i) many += "u,";
  EXPECT_THAT(error(many + "]}\n"), HasSubstr("more than 100000 keys and values"));
}

TEST_F(ScenarioFile, DeepNestingIsRefused) {
  for (const std::string begin : {"[", "{a: ", "- ", "? ", "&a [", "!t [", "[{a: ", "a:\n "})
    for (const int levels : {33, 10'000}) {
      std::string text;
      for (int i = 0; i < levels; ++i) text += begin;
      EXPECT_THAT(error(text), testing::StartsWith(":")) << begin << levels;
    }
  EXPECT_THAT(error("runs: " + std::string(40, '[') + "x" + std::string(40, ']')),
              HasSubstr(":1:38: more than 32 levels"));
  // A chain of aliases is as deep as what it stands for.
  std::string chain = "a0: &a0 [x]\n";
  for (int i = 1; i < 1000; ++i) chain += fmt::format("a{0}: &a{0} [*a{1}]\n", i, i - 1);
  EXPECT_THAT(error(chain), HasSubstr("more than 32 levels"));
}

TEST_F(ScenarioFile, ALargeFileIsRefusedUnread) {
  const std::string runs = "runs: [{id: a, transport: udp}]\n";
  EXPECT_EQ(error(runs + std::string((1U << 20U) - runs.size(), '\n')), "no error");
  std::ofstream(path_) << runs;
  std::filesystem::resize_file(path_, 64U << 20U);
  try {
    read_scenario(path_, {});
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.exit, 2);
    EXPECT_THAT(error.what(), testing::AllOf(HasSubstr("67108864 bytes"), HasSubstr("at most 1048576")));
  }
  EXPECT_THROW(read_scenario("/dev/zero", {}), Error) << "no end to be waited for";
}

TEST_F(ScenarioFile, RepetitionsTakeNoRoom) {
  const std::string runs = "runs: [{id: a, transport: [udp, fastdds]}, {id: b, transport: udp}]\n";
  const auto scenario = read("repeat: 33333\n" + runs);
  EXPECT_EQ(scenario.runs.size(), 3U);
  ASSERT_EQ(scenario.size(), 99'999U);
  EXPECT_EQ(scenario.at(99'998).id, "b");
  EXPECT_EQ(scenario.at(99'998).repetition, 33'333);
  EXPECT_EQ(scenario.at(3).repetition, 2);
  EXPECT_THAT(error("repeat: 33334\n" + runs), HasSubstr(":1:9: repeat: 3 runs, 33334 times, are 100002"));
  EXPECT_THAT(error("repeat: 1000000\n" + runs), HasSubstr("from 1 to 100000"));
  for (const auto* wrong : {"0", "-1", "1e3", "1.0", "99999999999999999999", "many", "[1]", "''"})
    EXPECT_THAT(error("repeat: " + std::string(wrong) + "\n" + runs), HasSubstr(":1:9: repeat")) << wrong;
}

TEST_F(ScenarioFile, RunsHaveABound) {
  const auto list = [](int count) {
    std::string text = "[";
    for (int i = 1; i <= count; ++i) text += fmt::format("{}{} B", i == 1 ? "" : ", ", i);
    return text + "]";
  };
  const auto with = [&](int a, int b) {
    return "defaults: {transport: udp}\nruns:\n  - {id: a, payload: " + list(a) +
           ", load: {controller: {vm-bytes: " + list(b) + "}}}\n";
  };
  EXPECT_EQ(read(with(1000, 10)).size(), 10'000U);
  EXPECT_THAT(error(with(1000, 11)),
              HasSubstr(":3:5: run 'a': with every combination of its lists there are more"));
  // The product of many lists is beyond all integers.
  std::string lists = "runs: [{id: a, transport: udp, options: {x0: [1, 2]";
  for (int i = 1; i < 200; ++i) lists += fmt::format(", x{}: [1, 2]", i);
  EXPECT_THAT(error(lists + "}}]\n"), HasSubstr("more than 10000 different runs"));
  // Neither may what they hold be multiplied at will.
  std::string heavy = "defaults: {transport: udp, options: {config: " + std::string(500'000, 'x') + "}}\n";
  EXPECT_THAT(error(heavy + "runs:\n  - {id: a, payload: " + list(1000) + "}\n"),
              HasSubstr(":3:5: run 'a': the runs until here hold more than"));
  std::string wide = "defaults:\n  transport: udp\n  options: {o: 1";
  for (int i = 0; i < 10'000; ++i) wide += fmt::format(", o{}: 1", i);
  wide += "}\nruns:\n";
  for (int i = 0; i < 1000; ++i) wide += fmt::format("  - {{id: r{}}}\n", i);
  EXPECT_THAT(error(wide), HasSubstr("the runs until here hold more than"));
}

TEST_F(ScenarioFile, OnlyTextIsRead) {
  const std::string runs = "runs: [{id: a, transport: udp}]\n";
  EXPECT_THAT(error("title: caf\xe9\n" + runs), HasSubstr(":1:11: byte 0xe9 is not UTF-8"));
  EXPECT_THAT(error("title: caf\xc3\xa9\n" + runs), "no error");
  EXPECT_THAT(error("title: a\x1b[2J\n" + runs), HasSubstr(":1:9: byte 0x1b is a control character"));
  EXPECT_THAT(error("title: \"a\\e[2J\"\n" + runs), HasSubstr(":1:8: a control character"));
  EXPECT_THAT(error("title: a\n\x04\n" + runs), HasSubstr(":2:1: byte 0x04")) << "yaml-cpp's end of file";
  EXPECT_THAT(error(std::string("title: a\0b\n", 11) + runs), HasSubstr(":1:9: byte 0x00"));
  EXPECT_THAT(error("\xff\xfet"), HasSubstr(":1:1: byte 0xff is not UTF-8"));
  EXPECT_THAT(error("\xef\xbb\xbf" + runs), "no error");
  EXPECT_THAT(error(runs + "---\n" + runs), HasSubstr(":2:1: a second document"));
  EXPECT_THAT(error(runs + "]\n"), testing::StartsWith(":2:1:")) << "nothing is left unread";
}

// By it a run over one link is told from a run over another: in tables, and by its key.
TEST_F(ScenarioFile, WhatIsAskedHoldsTheLink) {
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

// Whatever a file holds, it is read or refused; it never crashes us.
TEST_F(ScenarioFile, DamagedFilesAreRefusedOrRead) {
  const std::string good =
      "title: T\nhosts: {controller: {interface: a}, component: {address: 1.2.3.4}}\nrepeat: 2\n"
      "defaults: {transport: [udp], payload: 5 B}\nruns:\n  - id: a\n    load: &l {controller: {cpu: 1}}\n  "
      "- {id: b, load: *l}\n";
  ASSERT_EQ(read(good).size(), 4U);
  std::mt19937 random(3);
  const std::string alphabet = " \n:{}[],-&*'\"#a1!|>%@";
  for (int round = 0; round < 500; ++round) {
    auto text = good;
    for (int edits = 1 + static_cast<int>(random() % 3); edits > 0; --edits)
      text[random() % text.size()] = alphabet[random() % alphabet.size()];
    try {
      read(text);
    } catch (const Error&) {  // refused: fine
    }
  }
}

TEST(Keys, AreUniqueAndExplained) {
  std::set<std::string> paths, flags;
  for (const auto& key : keys()) {
    EXPECT_TRUE(paths.insert(key.path).second) << key.path;
    EXPECT_TRUE(key.flag.empty() || flags.insert(key.flag).second) << key.flag;
    EXPECT_FALSE(key.help.empty()) << key.path;
  }
}

TEST_F(ScenarioFile, APresetOfTheKernelIsRefinedAndAnythingIsLeftAsItIs) {
  const auto scenario = read(
      "defaults: {transport: udp, kernel: {preset: paper}}\nruns:\n  - id: a\n  - {id: b, kernel: "
      "{ksoftirqd: 50, "
      "rmem-max: 8 MiB}}\n  - {id: c, kernel: {preset: none}}\n  - {id: d, kernel: {irq-threads: [as-is, "
      "95]}}\n");
  ASSERT_EQ(scenario.size(), 5U);
  EXPECT_EQ(scenario.runs[0].kernel, (settings::Wishes{{"irq-threads", "90"}, {"ksoftirqd", "60"}}));
  EXPECT_EQ(scenario.runs[1].kernel,
            (settings::Wishes{{"irq-threads", "90"}, {"ksoftirqd", "50"}, {"rmem-max", "8388608"}}));
  EXPECT_TRUE(scenario.runs[2].kernel.empty());
  EXPECT_EQ(scenario.runs[3].kernel, (settings::Wishes{{"ksoftirqd", "60"}}));
  EXPECT_EQ(scenario.runs[4].kernel.at("irq-threads"), "95");
  EXPECT_EQ(asked(scenario.runs[0], scenario.hosts).at("kernel").at("ksoftirqd"), "60");
  EXPECT_TRUE(asked(scenario.runs[2], scenario.hosts).at("kernel").is_null())
      << "as a version that knew of none";
}

TEST_F(ScenarioFile, WrongSettingsOfTheKernelAreRefused) {
  for (const auto& [kernel, expected] :
       std::map<std::string, std::string>{{"preset: mine", "paper, none"},
                                          {"ksoftirqd: 100", "kernel.ksoftirqd: '100'"},
                                          {"gro: maybe", "neither on nor off"},
                                          {"rmem-max: much", "kernel.rmem-max"},
                                          {"irq-thread: 9", "irq-threads"}})
    EXPECT_THAT(error("runs: [{id: a, transport: udp, kernel: {" + kernel + "}}]\n"), HasSubstr(expected))
        << kernel;
}

TEST(Scenarios, ThatWeShipAreRead) {
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

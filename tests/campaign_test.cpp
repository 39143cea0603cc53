// SPDX-License-Identifier: Apache-2.0
#include "campaign/campaign.hpp"

#include <filesystem>
#include <fstream>
#include <random>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

namespace ontime::campaign {
namespace {

using namespace std::chrono_literals;
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
  for (const auto* text : {"", "ten", "ms", "10", "10 parsec", "10 ms more", "nan s", "inf s", "1e300 s"})
    EXPECT_THROW(duration_of(text), std::invalid_argument) << text;
  for (const auto* text : {"500", "-1 B", "0.5 B", "1e30 B"})
    EXPECT_THROW(bytes_of(text), std::invalid_argument) << text;
  try {
    duration_of("10");
    FAIL();
  } catch (const std::invalid_argument& error) {
    EXPECT_THAT(error.what(), HasSubstr("10 ms"));
  }
}

class ScenarioFile : public testing::Test {
 protected:
  ScenarioFile()
      : path_(std::filesystem::temp_directory_path() /
              ("ontime-scenario-" + std::to_string(getpid()) + ".yaml")) {}
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
  for (const auto& run : scenario.runs)
    result.push_back(run.id + " " + run.task.transport + " " + std::to_string(run.task.client.payload_bytes) +
                     " " + std::to_string(run.repetition));
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

// Whatever a file holds, it is read or refused; it never crashes us.
TEST_F(ScenarioFile, DamagedFilesAreRefusedOrRead) {
  const std::string good =
      "title: T\nhosts: {controller: {interface: a}, component: {address: 1.2.3.4}}\nrepeat: 2\n"
      "defaults: {transport: [udp], payload: 5 B}\nruns:\n  - id: a\n    load: &l {controller: {cpu: 1}}\n  "
      "- {id: b, load: *l}\n";
  ASSERT_EQ(read(good).runs.size(), 4U);
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

// SPDX-License-Identifier: Apache-2.0
// Files that are too much, or no scenario at all.
#include <filesystem>
#include <fstream>
#include <random>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "campaign_scenario.hpp"

namespace ontime::campaign {
namespace {

using testing::HasSubstr;

TEST_F(ScenarioFile, AliasesThatNeverEndAreRefused) {
  EXPECT_THAT(error("defaults: &a {b: *a}\nruns: [{id: a, transport: udp}]\n"),
              HasSubstr(":1:18: this alias"));
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

TEST_F(ScenarioFile, TotalTimeDoesNotOverflow) {
  const auto run = parse_scenario("x.yaml", "runs: [{id: a, transport: udp, duration: 1000 h}]\n", {}).at(0);
  EXPECT_NEAR(time_of(run).count(), 3.6e6, 10);
  auto scenario =
      parse_scenario("x.yaml", "repeat: 1000\nruns: [{id: a, transport: udp, duration: 1000 h}]\n", {});
  EXPECT_NEAR(time_of(scenario).count(), 3.6e9, 1e4);
}

TEST(Duration, HasABound) {
  EXPECT_EQ(positive_duration("1000 h"), longest_duration);
  EXPECT_THROW(positive_duration("2000000 h"), std::invalid_argument);
  EXPECT_THROW(positive_duration("0 s"), std::invalid_argument);
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
  } catch (const scenario::Error& error) {
    EXPECT_THAT(error.what(), testing::AllOf(HasSubstr("67108864 bytes"), HasSubstr("at most 1048576")));
  }
  EXPECT_THROW(read_scenario("/dev/zero", {}), scenario::Error) << "no end to be waited for";
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
           ", load: {controller: {vm: 1, vm-bytes: " + list(b) + "}}}\n";
  };
  EXPECT_EQ(read(with(1000, 10)).size(), 10'000U);
  EXPECT_THAT(error(with(1000, 11)), HasSubstr(":3:5: run 'a': its lists"));
  // The product of many lists is beyond all integers.
  std::string lists = "runs: [{id: a, transport: udp, options: {x0: [1, 2]";
  for (int i = 1; i < 200; ++i) lists += fmt::format(", x{}: [1, 2]", i);
  EXPECT_THAT(error(lists + "}}]\n"), HasSubstr("more than 10000 different runs"));
  // Neither may what they hold be multiplied at will.
  std::string heavy = "defaults: {transport: udp, options: {config: " + std::string(500'000, 'x') + "}}\n";
  EXPECT_THAT(error(heavy + "runs:\n  - {id: a, payload: " + list(1000) + "}\n"),
              testing::AllOf(HasSubstr(":3:5: run 'a': "), HasSubstr("32 MiB")));
  std::string wide =
      "hosts: {controller: {interface: lo}, component: {interface: lo, address: 127.0.0.1}}\n"
      "defaults:\n  transport: of-their-own\n  options: {o: 1";
  for (int i = 0; i < 1000; ++i) wide += fmt::format(", o{}: {}", i, std::string(400, '1'));
  wide += "}\nruns:\n";
  for (int i = 0; i < 1000; ++i) wide += fmt::format("  - {{id: r{}}}\n", i);
  EXPECT_THAT(error(wide), HasSubstr("32 MiB"));
}

TEST_F(ScenarioFile, ATabInTheIndentationIsNamed) {
  const auto tab = [](const char* place) {
    return testing::AllOf(HasSubstr(place), HasSubstr("begins with a tab; YAML needs spaces"));
  };
  EXPECT_THAT(error("hosts: loopback\ndefaults:\n\ttransport: udp\nruns: [{id: a}]\n"),
              tab(":3:1: this line"));
  EXPECT_THAT(error("runs:\n  - id: a\n    kernel:\n    \tgro: on\n"), tab(":4:5: this line"));
  EXPECT_THAT(error("runs:\n\t- id: a\n"), tab(":2:1: this line"));
  EXPECT_THAT(error("runs:\n  -\tid: a\n    transport: udp\n"), tab(":2:4: this line"));
  EXPECT_THAT(error("runs:\n  - id: a\n    transport:\tudp\n"), "no error");
  EXPECT_THAT(error("runs: [\n\t{id: a, transport: udp}]\n"), "no error");
  EXPECT_THAT(error("runs: [\n"), testing::Not(HasSubstr("tab")));
}

TEST_F(ScenarioFile, OnlyTextIsRead) {
  const std::string runs = "runs: [{id: a, transport: udp}]\n";
  EXPECT_THAT(error("title: caf\xe9\n" + runs), HasSubstr(":1:11: byte 0xe9 is not UTF-8"));
  EXPECT_THAT(error("title: caf\xc3\xa9\n" + runs), "no error");
  EXPECT_THAT(error("title: a\x1b[2J\n" + runs), HasSubstr(":1:9: byte 0x1b is a control character"));
  EXPECT_THAT(error("title: \"a\\e[2J\"\n" + runs),
              testing::AllOf(HasSubstr(":1:8: "), HasSubstr("control character")));
  EXPECT_THAT(error("title: a\n\x04\n" + runs), HasSubstr(":2:1: byte 0x04")) << "yaml-cpp's end of file";
  EXPECT_THAT(error(std::string("title: a\0b\n", 11) + runs), HasSubstr(":1:9: byte 0x00"));
  EXPECT_THAT(error("\xff\xfet"), HasSubstr(":1:1: byte 0xff is not UTF-8"));
  EXPECT_THAT(error("\xef\xbb\xbf" + runs), "no error");
  EXPECT_THAT(error(runs + "---\n" + runs), HasSubstr(":2:1: a second document"));
  EXPECT_THAT(error(runs + "]\n"), testing::StartsWith(":2:1:")) << "nothing is left unread";
}

TEST_F(ScenarioFile, TagIsRefused) {
  EXPECT_THAT(error("runs: [{id: a, transport: udp, payload: !!int 500 B}]\n"),
              HasSubstr(":1:41: the tag 'tag:yaml.org,2002:int'"));
  EXPECT_THAT(error("runs: !list [{id: a, transport: udp}]\n"), HasSubstr(":1:7: the tag '!list'"));
  EXPECT_THAT(error("hosts: !<x> {}\nruns: [{id: a, transport: udp}]\n"), HasSubstr(":1:8: the tag 'x'"));
  EXPECT_EQ(error("runs: [{id: 'a', transport: \"udp\"}]\n"), "no error");
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
    } catch (const scenario::Error&) {  // refused: fine
    }
  }
}

}  // namespace
}  // namespace ontime::campaign

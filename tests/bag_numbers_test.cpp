// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <numeric>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "bag/bag.hpp"
#include "bag_fixture.hpp"

namespace ontime::bag {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

TEST_F(Bags, NumbersOfTheWriterTellWhatIsLostRepeatedAndOutOfOrder) {
  const auto flow = judged_mcap(mcap(numbered({7, 8, 11, 10, 11, 12}, true))).flows.at(0);
  EXPECT_EQ(flow.lost, 1U);  // 9
  EXPECT_EQ(flow.reordered, 1U);
  EXPECT_EQ(flow.duplicated, 1U);
  EXPECT_EQ(flow.messages, 5U);
}

// The count of a writer that is recorded from its start looks like the recorder's own, until now.
TEST_F(Bags, RepeatedMessageIsNoLossFromTheFirstNumberOn) {
  struct Case {
    std::vector<std::uint32_t> after_first;
    std::uint64_t messages, lost, reordered;
  };
  for (const std::uint32_t first : {0U, 1U, 2U, 1000U})
    for (const auto& [after_first, messages, lost, reordered] :
         {Case{{0, 1, 2, 3, 4, 2, 5, 6, 7, 8}, 9, 0, 0}, Case{{0, 1, 2, 3, 4, 0, 5}, 6, 0, 0},
          Case{{0, 1, 2, 4, 5, 1, 7}, 6, 2, 0}, Case{{0, 2, 1, 0, 3, 5}, 5, 1, 1},
          Case{{1, 0, 2, 0, 4}, 4, 1, 1}}) {
      auto numbers = after_first;
      for (auto& number : numbers) number += first;
      const auto flow = judged_mcap(mcap(numbered(numbers, true))).flows.at(0);
      EXPECT_EQ(flow.messages, messages) << ::testing::PrintToString(numbers);
      EXPECT_EQ(flow.lost, lost) << ::testing::PrintToString(numbers);
      EXPECT_EQ(flow.duplicated, 1U) << ::testing::PrintToString(numbers);
      EXPECT_EQ(flow.reordered, reordered) << ::testing::PrintToString(numbers);
    }
}

TEST_F(Bags, RepeatedMessageOfTheFileBeforeIsNoLoss) {
  fs::create_directory(folder_ / "drive");
  std::uint32_t next = 0;
  for (const auto* name : {"drive/drive_0.mcap", "drive/drive_1.mcap"}) {
    std::vector<std::uint32_t> numbers;
    if (next != 0) numbers.push_back(next - 2);
    for (const auto end = next + 50; next < end; ++next) numbers.push_back(next);
    write(name, mcap(numbered(numbers, true)));
  }
  const auto flow = judged((folder_ / "drive").string()).flows.at(0);
  EXPECT_EQ(flow.messages, 100U);
  EXPECT_EQ(flow.lost, 0U);
  EXPECT_EQ(flow.duplicated, 1U);
}

// As an older rosbag2 did, from 0 in each file.
TEST_F(Bags, NumbersThatTheRecorderCountedTellNothing) {
  fs::create_directory(folder_ / "drive");
  for (const auto* name : {"drive/drive_0.mcap", "drive/drive_1.mcap"}) {
    std::string records = channel(1, 0, "/a");
    for (std::uint32_t sequence = 0; sequence < 4; ++sequence) records += message(1, {start, -1, sequence});
    write(name, mcap(records));
  }
  const auto flow = judged((folder_ / "drive").string()).flows.at(0);
  EXPECT_EQ(flow.messages, 8U);
  EXPECT_FALSE(flow.lost);
  EXPECT_EQ(flow.duplicated, 0U);
}

// As `mcap convert` does.
TEST_F(Bags, NumbersThatAllTopicsShareTellNothing) {
  std::string records = channel(1, 0, "/imu") + channel(2, 0, "/scan");
  std::int64_t at_ns = start;
  for (std::uint32_t sequence = 0; sequence < 60; ++sequence)
    records += message(sequence % 6 == 5 ? 2 : 1, {at_ns += ms, -1, sequence});
  for (const auto& flow : judged_mcap(mcap(records)).flows) {
    EXPECT_FALSE(flow.lost) << flow.topic;
    EXPECT_EQ(flow.reordered, 0U);
  }
}

TEST_F(Bags, NumbersOfEachTopicTellWhatIsLost) {
  std::string records = channel(1, 0, "/imu") + channel(2, 0, "/scan");
  for (const auto& [topic, sequence] :
       {std::pair(1, 5), {2, 900}, {1, 6}, {1, 8}, {2, 901}, {1, 9}, {2, 903}})
    records += message(static_cast<std::uint16_t>(topic), {start, -1, static_cast<std::uint32_t>(sequence)});
  for (const auto& flow : judged_mcap(mcap(records)).flows) EXPECT_EQ(flow.lost, 1U) << flow.topic;
}

TEST_F(Bags, WritersThatNumberAlikeAreOneStreamOfUnknownLoss) {
  for (const std::uint32_t other : {0U, 500U, 100'000U}) {
    std::vector<std::uint32_t> numbers;
    for (std::uint32_t number = 1; number <= 100; ++number)
      numbers.insert(numbers.end(), {number, number + other});
    const auto findings = judged_mcap(mcap(numbered(numbers)));
    const auto& flow = findings.flows.at(0);
    EXPECT_EQ(flow.messages, 200U) << other;
    EXPECT_EQ(flow.period.count(), 199U);
    EXPECT_FALSE(flow.lost);
    EXPECT_EQ(flow.duplicated, 0U);
    EXPECT_EQ(flow.reordered, 0U);
    EXPECT_THAT(findings.remarks, Contains(HasSubstr("several writers")));
  }
}

TEST_F(Bags, SecondWriterThatIsSlowerLosesNothing) {
  for (const std::int64_t ahead : {0, 1}) {  // whether times of writing are known
    std::string records = channel(1, 0, "/a");
    std::int64_t at_ns = start;
    for (std::uint32_t sequence = 1; sequence <= 100; ++sequence) {
      records += message(1, {at_ns, at_ns - ahead, 6000 + sequence});
      if (sequence % 10 == 0) records += message(1, {at_ns, at_ns - ahead, 600 + sequence / 10});
      at_ns += ms;
    }
    const auto flow = judged_mcap(mcap(records)).flows.at(0);
    EXPECT_EQ(flow.messages, 110U);
    EXPECT_FALSE(flow.lost) << *flow.lost;
  }
}

TEST_F(Bags, MessageThatOvertookSeveralLeavesTheLossesKnown) {
  const auto flow = judged_mcap(mcap(numbered({105, 107, 108, 112, 109, 110, 111, 113}, true))).flows.at(0);
  EXPECT_EQ(flow.lost, 1U);
  EXPECT_EQ(flow.reordered, 3U);
}

TEST_F(Bags, WriterThatBeganAnewBeforeItsFirstNumberHereLosesNothing) {
  std::vector<std::uint32_t> numbers(200);
  std::iota(numbers.begin(), numbers.begin() + 100, 500U);
  std::iota(numbers.begin() + 100, numbers.end(), 3U);
  const auto flow = judged_mcap(mcap(numbered(numbers))).flows.at(0);
  EXPECT_EQ(flow.lost, 0U);
  EXPECT_EQ(flow.reordered, 0U);
}

TEST_F(Bags, WriterThatBeganAnewSoonKeepsItsLosses) {
  std::vector<std::uint32_t> numbers;
  for (int begun = 0; begun < 2; ++begun)
    for (std::uint32_t number = 1; number <= 1000; ++number)
      if (number != 500) numbers.push_back(number);
  const auto flow = judged_mcap(mcap(numbered(numbers))).flows.at(0);
  EXPECT_EQ(flow.messages, 1998U);
  EXPECT_EQ(flow.lost, 2U);
  EXPECT_EQ(flow.duplicated, 0U);
  EXPECT_EQ(flow.reordered, 0U);
}

TEST_F(Bags, FirstGapTellsThatNumbersAreTheWriters) {
  std::string records = channel(1, 0, "/a");
  for (const std::int64_t number : {0, 1, 2, 4, 5, 7})
    records += message(
        1, {start + number * 10 * ms, start + (number * 9 - 1) * ms, static_cast<std::uint32_t>(number)});
  EXPECT_EQ(judged_mcap(mcap(records)).flows.at(0).lost, 2U);
  EXPECT_THAT(values_of(age), ElementsAre(ms, 2 * ms, 3 * ms, -1, 5 * ms, 6 * ms, -1, 8 * ms));
}

}  // namespace
}  // namespace ontime::bag

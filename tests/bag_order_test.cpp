// SPDX-License-Identifier: Apache-2.0
// Messages that are recorded out of order, and clocks that were set back by less than a second.
#include <algorithm>
#include <numeric>
#include <random>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "bag/bag.hpp"
#include "bag_fixture.hpp"

namespace ontime::bag {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

// 500 messages, 10 ms apart.
std::string in_order(const std::vector<int>& order, bool has_stamps = false,
                     std::int64_t period_ns = 10 * ms) {
  std::string records = schema(1, "sensor_msgs/msg/Imu") + channel(1, has_stamps ? 1 : 0, "/a");
  for (const auto number : order) {
    const auto at_ns = start + number * period_ns;
    records += message(1, {at_ns}, has_stamps ? stamped(at_ns - ms) : "");
  }
  return mcap(records);
}

std::vector<int> ascending() {
  std::vector<int> order(500);
  std::iota(order.begin(), order.end(), 0);
  return order;
}

TEST_F(Bags, SwappedMessagesHaveThePeriodsOfTheirTimes) {
  for (const bool has_stamps : {false, true}) {
    auto order = ascending();
    for (std::size_t i = 9; i < 490; i += 10) std::swap(order[i], order[i + 1]);
    std::swap(order[498], order[499]);
    const auto flow =
        judged_mcap(in_order(order, has_stamps), {.deadline = 15ms, .period = {}, .age = {}}).flows.at(0);
    EXPECT_EQ(flow.late, 0U);
    EXPECT_EQ(flow.period.count(), 499U);
    EXPECT_EQ(flow.period.max_ns(), 10 * ms);
    EXPECT_DOUBLE_EQ(flow.rate_hz(), 100);
    EXPECT_EQ(flow.reordered, 50U) << "once, whatever shows it";
    EXPECT_EQ(flow.silent_ns, 0);
    EXPECT_THAT(misses_, IsEmpty());
  }
}

// These messages, from 100 on, come after 30 later ones.
std::vector<int> with_late(int messages) {
  auto order = ascending();
  std::rotate(order.begin() + 100, order.begin() + 100 + messages, order.begin() + 130 + messages);
  return order;
}

TEST_F(Bags, MessagesFromFurtherBackHaveThePeriodsOfTheirTimes) {
  for (const int messages : {1, 2, 5, 40, 100}) {
    const auto findings =
        judged_mcap(in_order(with_late(messages), false, 5 * ms), {.deadline = 7ms, .period = {}, .age = {}});
    const auto& flow = findings.flows.at(0);
    EXPECT_EQ(flow.late, 0U) << messages;
    EXPECT_EQ(flow.period.count(), 499U) << messages;
    EXPECT_EQ(flow.period.max_ns(), 5 * ms) << messages;
    EXPECT_EQ(flow.reordered, static_cast<std::uint64_t>(messages));
    EXPECT_THAT(findings.remarks, IsEmpty());
  }
}

TEST_F(Bags, MessagesFromTooFarBackHaveNoPeriodAndMakeNoGapOfTheNext) {
  auto order = ascending();
  std::rotate(order.begin() + 100, order.begin() + 109, order.begin() + 400);
  const auto findings = judged_mcap(in_order(order, false, ms), {.deadline = 5ms, .period = {}, .age = {}});
  const auto& flow = findings.flows.at(0);
  EXPECT_EQ(flow.late, 1U) << "where they are missing";
  EXPECT_EQ(flow.period.max_ns(), 10 * ms);
  EXPECT_EQ(flow.period.count(), 490U);
  EXPECT_EQ(flow.reordered, 9U);
  EXPECT_THAT(findings.remarks, ElementsAre(HasSubstr("9 messages out of order, or the first")));
}

TEST_F(Bags, GapOfASlowTopicIsKnownASecondLater) {
  std::string records = channel(1, 0, "/fast") + channel(2, 0, "/slow");
  for (int i = 0; i < 1000; ++i) {
    if (i != 900) records += message(1, {start + i * 10 * ms});
    if (i % 50 == 0 && i != 100) records += message(2, {start + i * 10 * ms});
  }
  judged_mcap(mcap(records), {.deadline = 15ms, .period = {}, .age = {}});
  const auto at = [&](std::int64_t gap_ns) {
    return std::ranges::find(misses_, gap_ns, &listen::Miss::value_ns);
  };
  EXPECT_LT(at(1000 * ms), at(20 * ms));
}

// After `before` messages the clock goes back, by less than a second.
std::vector<int> set_back(int before, int by) {
  auto order = ascending();
  for (auto& number : order) number -= number < before ? 0 : by;
  return order;
}

TEST_F(Bags, ClockThatWentBackALittleLeavesOnePeriodOut) {
  struct Case {
    int before, by;
    std::int64_t period_ns;
  };
  for (const auto& [before, by, period_ns] :
       std::initializer_list<Case>{{250, 5, 10 * ms},   // 50 ms
                                   {250, 30, 10 * ms},  // 300 ms
                                   {250, 95, 10 * ms},
                                   {10, 6, 10 * ms},
                                   {495, 50, 10 * ms},  // the last messages are behind
                                   {250, 2, 250 * ms},
                                   {250, 3, 250 * ms},
                                   {250, 60, ms},
                                   {300, 200, ms}}) {
    const auto findings =
        judged_mcap(in_order(set_back(before, by), false, period_ns),
                    {.deadline = std::chrono::nanoseconds(period_ns * 3 / 2), .period = {}, .age = {}});
    const auto& flow = findings.flows.at(0);
    EXPECT_EQ(flow.late, 0U) << by;
    EXPECT_EQ(flow.period.count(), 498U) << by;
    EXPECT_NEAR(flow.rate_hz(), 1e9 / static_cast<double>(period_ns), 1e-6) << by;
    EXPECT_EQ(flow.reordered, 0U) << by;
    EXPECT_THAT(findings.remarks, ElementsAre(HasSubstr("1 message out of order, or the first"))) << by;
  }
}

TEST_F(Bags, ClockThatWentBackALittleHidesNoGap) {
  for (const std::size_t after : {2, 5, 20}) {  // messages, then 200 ms of silence
    auto order = set_back(250, 30);
    for (auto i = 250 + after; i < order.size(); ++i) order[i] += 19;
    const auto findings = judged_mcap(in_order(order), {.deadline = 15ms, .period = {}, .age = {}});
    const auto& flow = findings.flows.at(0);
    EXPECT_EQ(flow.late, 1U) << after;
    EXPECT_EQ(flow.period.max_ns(), 200 * ms) << after;
    EXPECT_EQ(flow.period.count(), 498U) << after;
    EXPECT_THAT(findings.remarks, ElementsAre(HasSubstr("clock was set"))) << after;
  }
}

TEST_F(Bags, ClockThatWentBackALittleBetweenTwoFilesHidesNoGap) {
  fs::create_directory(folder_ / "bag");
  auto order = ascending();
  for (std::size_t i = 260; i < 500; ++i) order[i] += 9;  // 100 ms
  write("bag/bag_0.mcap", in_order({order.begin(), order.begin() + 250}));
  for (auto& number : order) number -= 30;
  write("bag/bag_1.mcap", in_order({order.begin() + 250, order.end()}));
  const auto findings = judged((folder_ / "bag").string(), {.deadline = 15ms, .period = {}, .age = {}});
  EXPECT_EQ(findings.flows.at(0).late, 1U);
  EXPECT_EQ(findings.flows.at(0).period.max_ns(), 100 * ms);
  EXPECT_THAT(findings.remarks, testing::Contains(HasSubstr("1 message out of order, or the first")));
}

// One message, then silence until after the latest time: it may be late, or the clock was set.
TEST_F(Bags, MessageThatMayBeOfAClockThatWasSetHasNoPeriodAndARemark) {
  auto order = set_back(250, 30);
  for (std::size_t i = 251; i < order.size(); ++i) order[i] += 40;
  const auto findings = judged_mcap(in_order(order), {.deadline = 15ms, .period = {}, .age = {}});
  EXPECT_EQ(findings.flows.at(0).late, 1U) << "at least from the latest time on";
  EXPECT_EQ(findings.flows.at(0).period.count(), 498U);
  EXPECT_THAT(findings.remarks, ElementsAre(HasSubstr("1 message out of order, or the first")));
}

TEST_F(Bags, ClockThatWentBackALittleIsSeenInMessagesThatComeInPairs) {
  std::string records = channel(1, 0, "/a");
  for (int i = 0; i < 300; ++i) {
    const auto at_ns = start + (i * 10 - (i < 150 ? 0 : 304) + (i < 160 ? 0 : 100)) * ms;
    records += message(1, {at_ns}) + message(1, {at_ns + ms / 10});
  }
  const auto findings = judged_mcap(mcap(records), {.deadline = 15ms, .period = {}, .age = {}});
  EXPECT_EQ(findings.flows.at(0).late, 1U);
  EXPECT_NEAR(static_cast<double>(findings.flows.at(0).period.max_ns()), 109.9e6, 1);
  EXPECT_THAT(findings.remarks, ElementsAre(HasSubstr("1 message out of order, or the first")));
}

// A topic of 100 Hz with a jitter of up to 1 ms, which the seed decides.
std::vector<std::int64_t> jittery(unsigned seed) {
  std::minstd_rand random(seed + 1);
  std::vector<std::int64_t> times_ns;
  for (int i = 0; i < 500; ++i)
    times_ns.push_back(start + i * 10 * ms + static_cast<std::int64_t>(random() % 2'000'001) - ms);
  return times_ns;
}

std::string of_times(const std::vector<std::int64_t>& times_ns) {
  std::string records = channel(1, 0, "/a");
  for (const auto at_ns : times_ns) records += message(1, {at_ns});
  return mcap(records);
}

constexpr listen::Limits gap_of_15_ms{.deadline = 15ms, .period = {}, .age = {}};

// Each lies between earlier ones, as after a clock that was set back; but there one is missing.
TEST_F(Bags, LateMessagesApartFromOneAnotherAreNoClockThatWasSet) {
  for (unsigned seed = 0; seed < 20; ++seed)
    for (const auto messages : {2U, 3U, 5U, 12U, 24U}) {
      auto times_ns = jittery(seed);
      const auto every = 2 + seed % 2;  // of these is late
      std::vector<std::int64_t> late, others;
      for (std::size_t i = 200; i < 280; ++i)
        (i % every == 0 && late.size() < messages ? late : others).push_back(times_ns[i]);
      for (auto i = times_ns.begin() + 280; i != times_ns.end(); ++i) *i += 190 * ms;  // a true gap
      auto next = std::ranges::copy(others, times_ns.begin() + 200).out;
      std::ranges::copy(late, next);
      const auto findings = judged_mcap(of_times(times_ns), gap_of_15_ms);
      const auto& flow = findings.flows.at(0);
      EXPECT_EQ(flow.late, 1U) << seed << ' ' << messages;
      EXPECT_EQ(flow.period.count(), 499U) << seed << ' ' << messages;
      EXPECT_NEAR(static_cast<double>(flow.period.max_ns()), 200e6, 2e6) << seed << ' ' << messages;
      EXPECT_EQ(flow.reordered, messages) << seed;
      EXPECT_THAT(findings.remarks, IsEmpty()) << seed << ' ' << messages;
    }
}

// One in twenty is lost; the clock goes back by 300 ms, and a gap of 200 ms follows after some messages.
TEST_F(Bags, ClockThatWentBackALittleIsSeenInJitterAndLoss) {
  for (unsigned seed = 0; seed < 100; ++seed)
    for (const int after : {2, 5, 20, 100}) {
      auto times_ns = jittery(seed);
      for (std::size_t i = 250; i < 500; ++i) times_ns[i] -= 300 * ms;
      for (auto i = static_cast<std::size_t>(250 + after); i < 500; ++i) times_ns[i] += 190 * ms;
      std::minstd_rand random(seed + 1000);
      std::erase_if(times_ns, [&](auto) { return random() % 20 == 0; });
      const auto findings = judged_mcap(of_times(times_ns), {.deadline = 150ms, .period = {}, .age = {}});
      EXPECT_EQ(findings.flows.at(0).late, 1U) << seed << ' ' << after;
      EXPECT_EQ(findings.flows.at(0).reordered, 0U) << seed << ' ' << after;
      EXPECT_EQ(findings.flows.at(0).period.count(), times_ns.size() - 2) << seed << ' ' << after;
      EXPECT_THAT(findings.remarks, ElementsAre(HasSubstr("1 message out of order, or the first")))
          << seed << ' ' << after;
    }
}

// Two writers, 100 us apart: neither is missing where the other one is.
TEST_F(Bags, SwappedMessagesOfSeveralWritersAreNoClockThatWasSet) {
  std::string records = channel(1, 0, "/a");
  for (int i = 0; i < 300; ++i) {
    const std::int64_t at_ns = start + i * 10 * ms, other_ns = at_ns + ms / 10;
    records += i % 3 == 0 ? message(1, {other_ns}) + message(1, {at_ns})
                          : message(1, {at_ns}) + message(1, {other_ns});
  }
  const auto findings = judged_mcap(mcap(records));
  EXPECT_EQ(findings.flows.at(0).period.count(), 599U);
  EXPECT_EQ(findings.flows.at(0).reordered, 100U);
  EXPECT_THAT(findings.remarks, IsEmpty());
}

TEST_F(Bags, SwappedMessagesAtTheBeginningHaveThePeriodsOfTheirTimes) {
  for (const int messages : {2, 6, 40}) {
    auto order = ascending();
    std::reverse(order.begin(), order.begin() + messages);
    const auto findings = judged_mcap(in_order(order), {.deadline = 15ms, .period = {}, .age = {}});
    const auto& flow = findings.flows.at(0);
    EXPECT_EQ(flow.late, 0U) << messages;
    EXPECT_EQ(flow.period.count(), 499U) << messages;
    EXPECT_EQ(flow.period.max_ns(), 10 * ms) << messages;
    EXPECT_EQ(flow.reordered, static_cast<std::uint64_t>(messages - 1));
    EXPECT_THAT(findings.remarks, IsEmpty());
  }
}

}  // namespace
}  // namespace ontime::bag

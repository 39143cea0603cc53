// SPDX-License-Identifier: Apache-2.0
// What `ontime listen` prints of a flow.
#include "listen_words.hpp"

#include <chrono>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace ontime::app {
namespace {

constexpr std::int64_t ms_ns = 1'000'000;

TEST(ListenWords, RateOfASlowTopicIsNotZero) {
  listen::Flow each_4_hours;
  each_4_hours.period.add(14'400'000 * ms_ns);
  EXPECT_THAT(text_of(each_4_hours, {}), testing::HasSubstr("  0.000069 Hz  "));
  listen::Flow flow;
  for (int i = 0; i < 2; ++i) flow.period.add(40'000 * ms_ns);
  EXPECT_THAT(text_of(flow, {}), testing::HasSubstr("  0.025 Hz  "));
  flow.period.add(1);
  for (int i = 0; i < 20'000; ++i) flow.period.add(50 * ms_ns);
  EXPECT_THAT(text_of(flow, {}), testing::HasSubstr("  18.5 Hz  "));
}

// Of datagrams that were captured in part no period is known.
TEST(ListenWords, RateOfMessagesWithoutAPeriodIsUnknown) {
  listen::Flow flow;
  flow.messages = 500;
  EXPECT_THAT(text_of(flow, {}), testing::HasSubstr("  rate unknown  "));
  EXPECT_TRUE(json_of(flow).at("rate_hz").is_null());
  flow.messages = 0;
  EXPECT_THAT(text_of(flow, {}), testing::HasSubstr("  0.0 Hz  "));
}

// A node that starts sends some parameters within a millisecond.
TEST(ListenWords, BurstOfFewMessagesHasNoRate) {
  listen::Flow flow;
  flow.messages = 4;
  for (int i = 0; i < 3; ++i) flow.period.add(40'000);
  EXPECT_THAT(way_of(flow),
              testing::AllOf(testing::EndsWith("  4 messages"), testing::Not(testing::HasSubstr("Hz"))));
  EXPECT_THAT(text_of(flow, {}),
              testing::AllOf(testing::HasSubstr("  4 messages\n"), testing::Not(testing::HasSubstr("Hz"))));
  EXPECT_TRUE(json_of(flow).at("rate_hz").is_null());
  flow.messages = 5;
  flow.period.add(1000 * ms_ns);
  EXPECT_THAT(way_of(flow), testing::EndsWith("  4.0 Hz"));
}

// A topic at 100 Hz is silent after some 15 ms.
TEST(ListenWords, ShortSilenceHasItsLengthAndOneMessageIsOne) {
  listen::Flow flow;
  flow.messages = 1;
  flow.silent_ns = 40 * ms_ns;
  const auto text = text_of(flow, {});
  EXPECT_THAT(text, testing::HasSubstr("SILENT for the last 40.0 ms "));
  EXPECT_THAT(text, testing::HasSubstr(" 1 message\n"));
  flow.silent_ns = 2000 * ms_ns;
  flow.messages = 2;
  const auto longer = text_of(flow, {});
  EXPECT_THAT(longer, testing::HasSubstr("SILENT for the last 2.0 s "));
  EXPECT_THAT(longer, testing::HasSubstr(" 2 messages\n"));
}

TEST(Clock, TimeBefore1970HasMillisecondsOfItsSecond) {
  EXPECT_THAT(clock_of(1'250'999'999), ::testing::EndsWith(":01.250"));
  EXPECT_THAT(clock_of(-1), ::testing::EndsWith(":59.999"));
  EXPECT_THAT(clock_of(-1'750'000'000), ::testing::EndsWith(":58.250"));
}

TEST(ListenWords, QuantilesHaveThreeDigitsAndTheMaximumHasAll) {
  EXPECT_EQ(in_rounded_ms(9'999'500), "10.0");
  EXPECT_EQ(in_rounded_ms(999'900), "1.00");
  EXPECT_EQ(in_rounded_ms(12'345), "0.012");
  EXPECT_EQ(in_rounded_ms(123'456'000), "123");
  listen::Flow periodic;
  for (int i = 0; i < 100; ++i) periodic.period.add(9'999'500);
  EXPECT_THAT(text_of(periodic, {}), testing::HasSubstr("period p50 10.0 ms  p99 10.0 ms  max 9.999 ms\n"));
  periodic.period = {};
  periodic.period.add(100'000'000);
  EXPECT_THAT(text_of(periodic, {}), testing::HasSubstr("period p50 100 ms  p99 100 ms  max 100 ms\n"));
}

TEST(ListenWords, AgesFromAClockThatIsAheadAreNotOnTime) {
  using namespace std::chrono_literals;
  listen::Flow flow;
  flow.topic = "/scan";
  flow.reader = {0, "recorder"};
  flow.messages = 3;
  flow.age_from = listen::AgeFrom::stamp;
  flow.age_unknown = 0;
  flow.stamp_ahead = 2;
  flow.age.emplace();
  for (const auto ns : {-1, -1, 1}) flow.age->add(ns);
  const listen::Limits age{.deadline = {}, .period = {}, .age = 2ms};
  EXPECT_THAT(text_of(flow, age), testing::HasSubstr("    late 0 of 1  stamp ahead 2  lost unknown"));
  EXPECT_THAT(open_age_of(flow), testing::StartsWith("2 of 3 stamps of /scan are later than the recording"));
  EXPECT_EQ(json_of(flow).at("stamp_ahead"), 2);
  flow.age_from = listen::AgeFrom::writer;  // of packets
  EXPECT_THAT(open_age_of(flow), testing::StartsWith("2 of 3 stamps of /scan are later than the capture"));
  flow.stamp_ahead = 3;
  EXPECT_THAT(text_of(flow, age), testing::HasSubstr("    late unknown  stamp ahead 3  lost unknown"));
  flow.age_unknown = 1;
  EXPECT_THAT(open_age_of(flow),
              testing::StartsWith("the age of 1 of 3 messages of /scan is unknown; 3 of 3"));
}

TEST(ListenWords, ShareOfTheTimeIsWholeOnlyIfNothingWasLeftOut) {
  EXPECT_THAT(pauses_of(0.9998, 1), testing::StartsWith("listened 99.98 % of the time, with 1 pause;"));
  EXPECT_THAT(pauses_of(0.75, 20), testing::StartsWith("listened 75 % of the time, with 20 pauses;"));
}

TEST(ListenWords, DayIsToldWhereItChanges) {
  constexpr std::int64_t day_ns = std::int64_t{24 * 3600} * 1'000'000'000;
  const auto first_ns = 20'000 * day_ns, next_ns = first_ns + 2 * day_ns;
  std::string day;
  EXPECT_EQ(change_of_day(first_ns, day), "");
  EXPECT_EQ(change_of_day(first_ns + 1, day), "");
  EXPECT_EQ(change_of_day(next_ns, day),
            fmt::format("until here {}, from here on {}\n", day_of(first_ns), day_of(next_ns)));
  EXPECT_EQ(change_of_day(next_ns, day), "");
}

TEST(ListenWords, FirstMessageHasNoPeriodAndIsNotJudgedByOne) {
  using namespace std::chrono_literals;
  listen::Flow flow;
  flow.reader = {0, "recorder"};
  flow.messages = 5;
  for (int i = 0; i < 4; ++i) flow.period.add(ms_ns);
  EXPECT_THAT(text_of(flow, {.deadline = 2ms, .period = {}, .age = {}}), testing::HasSubstr("late 0 of 4 "));
  EXPECT_THAT(text_of(flow, {.deadline = 2ms, .period = {}, .age = 2ms}),
              testing::HasSubstr("late 0 of 4 (by period only)"));
  flow.age.emplace();
  for (int i = 0; i < 5; ++i) flow.age->add(ms_ns);
  EXPECT_THAT(text_of(flow, {.deadline = 2ms, .period = {}, .age = 2ms}), testing::HasSubstr("late 0 of 5 "));
}

TEST(ListenWords, MessagesWithoutAKnownAgeAreNotOnTimeByTheirAge) {
  using namespace std::chrono_literals;
  listen::Flow flow;
  flow.messages = 500;
  flow.age_unknown = 499;
  flow.age.emplace().add(ms_ns);
  const listen::Limits age{.deadline = {}, .period = {}, .age = 2ms};
  EXPECT_THAT(text_of(flow, age), testing::HasSubstr("    late 0 of 1  age unknown 499  lost unknown"));
  EXPECT_THAT(text_of(flow, {.deadline = 2ms, .period = {}, .age = 2ms}),
              testing::HasSubstr("late 0 of 500  age unknown 499 "));
  EXPECT_EQ(json_of(flow).at("age_unknown"), 499);
  flow.age_unknown = 0;
  EXPECT_THAT(text_of(flow, age), testing::HasSubstr("    late 0 of 1  lost unknown"))
      << "the others came before their writer was recognized";
  flow.age.reset();
  EXPECT_THAT(text_of(flow, age), testing::HasSubstr("    late unknown  lost unknown"));
  EXPECT_EQ(json_of(listen::Flow{}).at("age_unknown"), nullptr);
}

}  // namespace
}  // namespace ontime::app

// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "bag/bag.hpp"
#include "bag_fixture.hpp"

namespace ontime::bag {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

TEST_F(Bags, EachTopicHasItsPeriodsAndGaps) {
  const auto findings =
      judged_mcap(mcap(channel(1, 0, "/a") + channel(2, 0, "/b") + message(1, {start}) + message(2, {start}) +
                       message(1, {start + 10 * ms}) + message(1, {start + 20 * ms}) +
                       message(1, {start + 50 * ms}) + message(2, {start + 50 * ms})),
                  {.deadline = 20ms, .period = {}, .age = {}});
  ASSERT_EQ(findings.flows.size(), 2U);
  const auto& [a, b] = std::pair(findings.flows[0], findings.flows[1]);
  EXPECT_EQ(a.topic, "/a");
  EXPECT_EQ(a.messages, 4U);
  EXPECT_EQ(a.period.count(), 3U);
  EXPECT_EQ(a.period.max_ns(), 30 * ms);
  EXPECT_DOUBLE_EQ(a.rate_hz(), 60);
  EXPECT_EQ(a.late, 1U);
  EXPECT_EQ(b.messages, 2U);
  EXPECT_EQ(b.late, 1U);
  EXPECT_FALSE(a.age);
  EXPECT_FALSE(a.lost);  // the recorder noted no numbers
  ASSERT_EQ(misses_.size(), 2U);
  EXPECT_EQ(misses_[0].kind, listen::Miss::Kind::gap);
  EXPECT_EQ(misses_[0].value_ns, 30 * ms);
  EXPECT_EQ(misses_[0].at_ns, start + 50 * ms);
  EXPECT_THAT(findings.remarks, IsEmpty());
}

TEST_F(Bags, AgeRunsFromTheHeadersStampInEitherByteOrder) {
  for (const bool is_little : {true, false}) {
    const auto findings =
        judged_mcap(mcap(schema(1, "my_msgs/msg/Scan", scan_definition) + channel(1, 1, "/scan") +
                         message(1, {start + 7 * ms}, stamped(start, is_little)) +
                         message(1, {start + 50 * ms}, stamped(start + 20 * ms, is_little))),
                    {.deadline = {}, .period = {}, .age = 10ms});
    ASSERT_EQ(findings.flows.size(), 1U);
    const auto& flow = findings.flows[0];
    ASSERT_TRUE(flow.age);
    EXPECT_EQ(flow.age->count(), 2U);
    EXPECT_EQ(flow.age->max_ns(), 30 * ms);
    EXPECT_EQ(flow.age_from, listen::AgeFrom::stamp);
    EXPECT_EQ(flow.late, 1U);
    ASSERT_EQ(misses_.size(), 1U);
    EXPECT_EQ(misses_[0].kind, listen::Miss::Kind::age);
  }
}

TEST_F(Bags, OnlyTypesThatBeginWithAHeaderHaveAnAge) {
  const auto has_age = [&](const std::string& type, const std::string& definition,
                           const std::string& encoding = "cdr") {
    const auto findings = judged_mcap(mcap(schema(1, type, definition) + channel(1, 1, "/a", encoding) +
                                           message(1, {start + ms}, stamped(start))));
    return findings.flows.at(0).age.has_value();
  };
  EXPECT_TRUE(has_age("sensor_msgs/msg/Imu", ""));  // known by its name
  EXPECT_TRUE(has_age("x/msg/X", "Header header"));
  EXPECT_FALSE(has_age("x/msg/X", ""));
  EXPECT_FALSE(has_age("x/msg/X", "int32 number\nstd_msgs/Header header\n"));
  EXPECT_FALSE(has_age("x/msg/X", "std_msgs/Header[] headers\n"));
  EXPECT_FALSE(has_age("sensor_msgs/msg/Imu", "int32 number\n"));  // its definition is what counts
  EXPECT_FALSE(has_age("sensor_msgs/msg/Imu", "", "ros1"));
  // What begins after a line of "=" is another type.
  EXPECT_FALSE(has_age("x/msg/X", "# nothing\n=====\nMSG: y/Y\nstd_msgs/Header header\n"));
}

TEST_F(Bags, AgeIsUnknownWhereTheStampCannotBeRead) {
  for (const auto& data : {std::string(), std::string("\0\1\0\0\1\0\0", 7), std::string(40, '\xff'),
                           std::string("\0\3\0\0", 4) + std::string(20, '\1')}) {
    const auto findings =
        judged_mcap(mcap(schema(1, "sensor_msgs/msg/Imu") + channel(1, 1, "/a") + message(1, {start}, data)));
    EXPECT_EQ(findings.flows.at(0).messages, 1U);
    EXPECT_FALSE(findings.flows.at(0).age);
  }
}

TEST_F(Bags, MessagesWithoutAKnownAgeAreCounted) {
  const auto flow =
      judged_mcap(mcap(schema(1, "sensor_msgs/msg/Imu") + channel(1, 1, "/a") +
                       message(1, {start}, stamped(start - ms)) + message(1, {start + ms}, stamped(0)) +
                       message(1, {start + 2 * ms}, stamped(100 * 1000 * ms)) +
                       message(1, {start + 3 * ms}, "")))
          .flows.at(0);
  EXPECT_EQ(flow.age->count(), 1U);
  EXPECT_EQ(flow.age_unknown, 3U);
}

TEST_F(Bags, PublishTimeGivesTheAgeOfMessagesWithoutHeader) {
  const auto findings = judged_mcap(mcap(channel(1, 0, "/a") + message(1, {start + 3 * ms, start}) +
                                         message(1, {start + 9 * ms, start + 8 * ms})));
  const auto& flow = findings.flows.at(0);
  ASSERT_TRUE(flow.age);
  EXPECT_EQ(flow.age_from, listen::AgeFrom::publish);
  EXPECT_EQ(flow.age->max_ns(), 3 * ms);
}

TEST_F(Bags, RemarkSaysWhyAMessageWithoutHeaderHasNoAge) {
  const auto findings = judged_mcap(mcap(channel(1, 0, "/a") + message(1, {start, start})),
                                    {.deadline = {}, .period = {}, .age = 1ms});
  EXPECT_FALSE(findings.flows.at(0).age);
  EXPECT_THAT(findings.remarks, ElementsAre(HasSubstr("1 message without header.stamp")));
}

TEST_F(Bags, RemarksAreOfTheTopicsThatWereAskedFor) {
  const auto path =
      write("a.mcap", mcap(schema(1, "sensor_msgs/msg/Imu") + channel(1, 1, "/sim") + channel(2, 1, "/scan") +
                           message(1, {start}, stamped(0)) + message(2, {start + ms}, stamped(start))));
  for (const auto& [topic, remarks] : {std::pair{"/scan", 0U}, {"/sim", 1U}}) {
    const auto bag = open(path, {}, {topic});
    while (bag->listen_for(0ms)) {
    }
    EXPECT_EQ(bag->findings().remarks.size(), remarks) << topic;
  }
}

TEST_F(Bags, OddClocksAreRemarkedAndInventNoAge) {
  const auto scan = schema(1, "sensor_msgs/msg/Imu") + channel(1, 1, "/a");
  const auto findings_of = [&](std::int64_t stamp_ns) {
    return judged_mcap(mcap(scan + message(1, {start}, stamped(stamp_ns))),
                       {.deadline = {}, .period = {}, .age = 1ms});
  };
  const auto unset = findings_of(0);
  EXPECT_FALSE(unset.flows.at(0).age);
  EXPECT_THAT(unset.remarks, ElementsAre(HasSubstr("header.stamp of 0")));
  const auto simulated = findings_of(100 * 1000 * ms);
  EXPECT_FALSE(simulated.flows.at(0).age);
  EXPECT_EQ(simulated.flows.at(0).late, 0U);
  EXPECT_THAT(simulated.remarks, ElementsAre(HasSubstr("simulated")));
  const auto ahead = findings_of(start + ms);
  EXPECT_EQ(ahead.flows.at(0).age->max_ns(), 0);
  EXPECT_EQ(ahead.flows.at(0).stamp_ahead, 1U);
  EXPECT_EQ(ahead.flows.at(0).age_unknown, 0U);
  EXPECT_THAT(ahead.remarks, ElementsAre(HasSubstr("ahead")));
}

TEST_F(Bags, ClockThatWentBackMakesNoTopicSilent) {
  std::string records = channel(1, 0, "/a");
  for (int i = 0; i < 100; ++i) records += message(1, {start + (i < 50 ? 5000 + i : i) * 10 * ms});
  EXPECT_EQ(judged_mcap(mcap(records), {.deadline = 1s, .period = {}, .age = {}}).flows.at(0).silent_ns, 0);
}

TEST_F(Bags, ClockThatWentBackHidesNoTopicThatDied) {
  std::string records = channel(1, 0, "/a") + channel(2, 0, "/b");
  for (int i = 0; i < 300; ++i) {
    const auto at_ns = start + (i < 100 ? 360'000 + i : i) * 10 * ms;  // an hour
    if (i < 90) records += message(1, {at_ns});
    records += message(2, {at_ns});
  }
  const auto findings = judged_mcap(mcap(records), {.deadline = 1s, .period = {}, .age = {}});
  EXPECT_NEAR(static_cast<double>(findings.flows.at(0).silent_ns), 2.1e9, 0.02e9);
  EXPECT_EQ(findings.flows.at(1).silent_ns, 0);
  EXPECT_EQ(findings.flows.at(1).late, 0U);
  EXPECT_NEAR(findings.flows.at(1).rate_hz(), 100, 1e-6);
}

// 100 messages a second of each; what `late` says is how many of the first topic's gaps are judged so.
TEST_F(Bags, TopicWithStampsAheadIsNoClockThatWasSet) {
  for (const int every : {7, 2}) {
    std::string records = channel(1, 0, "/a") + channel(2, 0, "/b");
    for (int i = 0; i < 300; ++i) {
      const auto at_ns = start + i * 10 * ms;
      if (i < 100 || i >= 200) records += message(1, {at_ns});
      records += message(2, {at_ns + (i % every == 0 ? 60'000 * ms : 0)});
    }
    const auto findings = judged_mcap(mcap(records), {.deadline = 500ms, .period = {}, .age = {}});
    EXPECT_EQ(findings.flows.at(0).late, 1U) << every;
    EXPECT_EQ(findings.flows.at(0).period.count(), 199U) << every;
    EXPECT_EQ(findings.flows.at(0).silent_ns, 0) << every;
    EXPECT_EQ(findings.flows.at(1).silent_ns, 0) << every;
  }
}

TEST_F(Bags, OneMessageThatComesLateIsNoClockThatWasSet) {
  std::string records = channel(1, 0, "/a") + channel(2, 0, "/b");
  for (int i = 0; i < 300; ++i) {
    const auto at_ns = start + i * 10 * ms;
    records += message(1, {at_ns}) + message(2, {at_ns - (i == 250 ? 2000 * ms : 0)});
  }
  const auto findings = judged_mcap(mcap(records), {.deadline = 500ms, .period = {}, .age = {}});
  EXPECT_EQ(findings.flows.at(0).period.count(), 299U);
  EXPECT_EQ(findings.flows.at(0).silent_ns, 0);
  EXPECT_EQ(findings.flows.at(1).silent_ns, 0);
}

TEST_F(Bags, ClockThatWentBackBetweenTwoFilesMakesNoLiveTopicSilent) {
  const auto file = [](std::int64_t from_ns, bool has_third) {
    std::string records = channel(1, 0, "/a") + channel(2, 0, "/b") + channel(3, 0, "/dead");
    for (int i = 0; i < 200; ++i)
      for (const auto topic : std::initializer_list<std::uint16_t>{1, 2, 3})
        if (topic < 3 || has_third) records += message(topic, {from_ns + i * 10 * ms});
    return mcap(records);
  };
  fs::create_directory(folder_ / "bag");
  write("bag/bag_0.mcap", file(start + 100'000 * ms, true));
  write("bag/bag_1.mcap", file(start, false));
  const auto findings = judged((folder_ / "bag").string(), {.deadline = 500ms, .period = {}, .age = {}});
  EXPECT_EQ(findings.flows.at(0).silent_ns, 0);
  EXPECT_EQ(findings.flows.at(1).silent_ns, 0);
  EXPECT_NEAR(static_cast<double>(findings.flows.at(2).silent_ns), 2e9, 0.02e9);
}

// A topic that began only after the clock was set back knows nothing of it; nor does one of few messages.
TEST_F(Bags, ClockThatWentBackIsBelievedWhereNoOtherTopicCanTell) {
  for (const bool has_third : {false, true}) {
    std::string records = channel(1, 0, "/a") + channel(2, 0, "/dead") + channel(3, 0, "/new");
    for (int i = 0; i < 2000; ++i) {
      const auto at_ns = start + (i < 500 ? 360'000 + i : i) * 10 * ms;  // an hour back after 5 s
      records += message(1, {at_ns});
      if (i < 400) records += message(2, {at_ns});
      if (i >= 600 && has_third) records += message(3, {at_ns});
    }
    const auto findings = judged_mcap(mcap(records), {.deadline = 1s, .period = {}, .age = {}});
    EXPECT_EQ(findings.flows.at(0).silent_ns, 0);
    EXPECT_NEAR(static_cast<double>(findings.flows.at(1).silent_ns), 16e9, 0.05e9);
    EXPECT_EQ(findings.flows.back().silent_ns > 1'000'000'000, !has_third) << "/new, or /dead";
  }
}

TEST_F(Bags, ClockThatWentBackTwiceHidesNoTopicThatDied) {
  std::string records = channel(1, 0, "/a") + channel(2, 0, "/dead");
  for (int i = 0; i < 3000; ++i) {
    const auto at_ns = start + (i % 1000 + 1'000'000 - i / 1000 * 360'000) * 10 * ms;
    records += message(1, {at_ns});
    if (i < 500) records += message(2, {at_ns});
  }
  const auto findings = judged_mcap(mcap(records), {.deadline = 1s, .period = {}, .age = {}});
  EXPECT_EQ(findings.flows.at(0).silent_ns, 0);
  EXPECT_NEAR(static_cast<double>(findings.flows.at(1).silent_ns), 25e9, 0.05e9);
}

TEST_F(Bags, LastMessageFarAheadOfAllOthersNamesItsTopic) {
  for (const bool is_last_of_bag : {false, true}) {
    std::string records = channel(1, 0, "/a") + channel(2, 0, "/b"),
                ahead = message(2, {start + 3600'000 * ms});
    for (int i = 0; i < 300; ++i) {
      const auto at_ns = start + i * 10 * ms;
      records += message(1, {at_ns});
      if (i < 200) records += message(2, {at_ns});
      if (i == 200 && !is_last_of_bag) records += ahead;
    }
    if (is_last_of_bag) records += ahead;
    const auto findings = judged_mcap(mcap(records), {.deadline = 500ms, .period = {}, .age = {}});
    EXPECT_NEAR(static_cast<double>(findings.flows.at(0).silent_ns), 3597e9, 1e9);
    EXPECT_THAT(findings.remarks, testing::Contains(testing::AllOf(HasSubstr("/b"), HasSubstr("3597 s"))));
  }
}

TEST_F(Bags, TopicThatGoesOnAloneIsNoMessageFarAhead) {
  std::string records = channel(1, 0, "/a") + channel(2, 0, "/b") + message(1, {start});
  for (int i = 0; i < 30; ++i) records += message(2, {start + i * 1000 * ms});
  EXPECT_THAT(judged_mcap(mcap(records), {.deadline = 2s, .period = {}, .age = {}}).remarks, IsEmpty());
}

TEST_F(Bags, OneMessageThatComesLateMakesNoPause) {
  std::string records = channel(1, 0, "/a") + channel(2, 0, "/b") + channel(3, 0, "/rare");
  for (int i = 0; i < 300; ++i) {
    const auto at_ns = start + (10'000 + i) * 10 * ms;
    records += message(1, {at_ns - (i == 250 ? 60'000 * ms : 0)});
    if (i == 250) records += message(3, {at_ns});
    records += message(2, {at_ns});
  }
  EXPECT_THAT(judged_mcap(mcap(records)).remarks,
              testing::Not(testing::Contains(HasSubstr("no topic was recorded"))));
}

TEST_F(Bags, ClockThatIsSetBackWithoutEndIsRead) {
  constexpr std::int64_t nearly_a_year = std::int64_t{364} * 24 * 3600 * 1000 * ms;
  std::string records = channel(1, 0, "/a");
  for (int i = 0; i < 2000; ++i) records += message(1, {start + i % 2 * nearly_a_year});
  EXPECT_EQ(judged_mcap(mcap(records), {.deadline = 1s, .period = {}, .age = {}}).flows.at(0).messages,
            2000U);
  for (const auto& row : rows_) EXPECT_LT(row.to_ns, std::int64_t{1} << 60);
}

TEST_F(Bags, TopicThatIsOftenLateHidesNoGapOfSlowerOnes) {
  std::string records = channel(1, 0, "/odd") + channel(2, 0, "/slow") + channel(3, 0, "/slower");
  for (int i = 0; i < 10'000; ++i) {
    const auto at_ns = start + (6000 + i) * 10 * ms;
    records += message(1, {at_ns - (i % 2 == 0 ? 60'000 * ms : 0)});
    if (i % 100 == 0 && (i < 4000 || i > 5000)) records += message(2, {at_ns});
    if (i % 500 == 0) records += message(3, {at_ns});
  }
  const auto findings = judged_mcap(mcap(records), {.deadline = 7s, .period = {}, .age = {}});
  EXPECT_EQ(findings.flows.at(1).late, 1U) << "11 s";
  EXPECT_EQ(findings.flows.at(2).period.count(), 19U);
  EXPECT_EQ(findings.flows.at(2).silent_ns, 0);
}

// Some recorders write what is latched into each file again, with its first time.
TEST_F(Bags, TopicsThatEachFileRepeatsAreNoClockThatWasSet) {
  fs::create_directory(folder_ / "bag");
  for (int number = 0; number < 4; ++number) {
    std::string records = channel(1, 0, "/map") + channel(2, 0, "/tf_static") + channel(3, 0, "/a");
    for (int i = 0; i < 3; ++i) records += message(1, {start + i * ms}) + message(2, {start + i * ms});
    for (int i = 0; i < 1500; ++i) records += message(3, {start + (number * 1500 + i) * 10 * ms});
    write(fmt::format("bag/bag_{}.mcap", number), mcap(records));
  }
  const auto findings = judged((folder_ / "bag").string(), {.deadline = 500ms, .period = {}, .age = {}});
  EXPECT_EQ(findings.flows.at(0).topic, "/a");
  EXPECT_EQ(findings.flows.at(0).period.count(), 5999U);
  EXPECT_THAT(findings.remarks, testing::Not(testing::Contains(HasSubstr("no topic was recorded"))));
  EXPECT_EQ(findings.flows.at(0).late, 0U);
}

TEST_F(Bags, ClockThatWentBackLeavesMessagesInOrder) {
  std::string records = channel(1, 0, "/a");
  for (int i = 0; i < 300; ++i) {
    const auto at_ns = start + (i < 100 ? 360'000 + i : i) * 10 * ms;
    records += message(1, {at_ns, at_ns - 2 * ms});
  }
  EXPECT_LE(judged_mcap(mcap(records)).flows.at(0).reordered, 1U);
}

// Some writers keep a chunk for each topic: time goes back at each of them.
TEST_F(Bags, TopicsOneAfterTheOtherAreNoClockThatWasSet) {
  std::string records = channel(1, 0, "/a") + channel(2, 0, "/b");
  std::int64_t a = 0, b = 0;
  for (const auto topic : std::initializer_list<std::uint16_t>{1, 2, 1, 2})
    for (int i = 0; i < 200; ++i) records += message(topic, {start + ((topic == 1 ? a++ : b++) * 10) * ms});
  const auto findings = judged_mcap(mcap(records), {.deadline = 1s, .period = {}, .age = {}});
  for (const auto& flow : findings.flows) {
    EXPECT_EQ(flow.silent_ns, 0);
    EXPECT_EQ(flow.period.count(), 399U);
  }
  EXPECT_TRUE(findings.remarks.empty());
}

TEST_F(Bags, PauseOfAllTopicsIsRemarked) {
  std::string records = channel(1, 0, "/a") + channel(2, 0, "/b");
  for (const std::int64_t at_s : {0, 1, 3601, 3602})
    for (const auto topic : std::initializer_list<std::uint16_t>{1, 2})
      records += message(topic, {start + at_s * 1000 * ms});
  const auto findings = judged_mcap(mcap(records), {.deadline = 2s, .period = {}, .age = {}});
  EXPECT_EQ(findings.flows.at(0).late, 1U);
  EXPECT_THAT(findings.remarks, ElementsAre(HasSubstr("no topic was recorded for 3600 s:")));
}

TEST_F(Bags, OneStampOfAnotherClockLeavesTheOrderOfTheOthers) {
  std::string records = schema(1, "sensor_msgs/msg/Imu") + channel(1, 1, "/a");
  for (int i = 0; i < 10; ++i)
    records += message(1, {start + i * ms}, stamped(start + i * ms + (i == 2 ? 40'000'000'000 * ms : 0)));
  EXPECT_LE(judged_mcap(mcap(records)).flows.at(0).reordered, 1U);
}

TEST_F(Bags, ClockThatWentBackGivesNoPeriod) {
  const auto findings = judged_mcap(mcap(channel(1, 0, "/a") + message(1, {start + 2000 * ms}) +
                                         message(1, {start}) + message(1, {start + ms})));
  EXPECT_EQ(findings.flows.at(0).period.count(), 1U);
  EXPECT_THAT(findings.remarks, ElementsAre(HasSubstr("clock was set")));
}

TEST_F(Bags, LateMessageIsCountedOnceByPeriodAndAge) {
  const auto flow = judged_mcap(mcap(schema(1, "sensor_msgs/msg/Imu") + channel(1, 1, "/a") +
                                     message(1, {start}, stamped(start - 10 * ms)) +
                                     message(1, {start + 50 * ms}, stamped(start)) +
                                     message(1, {start + 51 * ms}, stamped(start + 51 * ms))),
                                {.deadline = 20ms, .period = {}, .age = 5ms})
                        .flows.at(0);
  EXPECT_EQ(flow.late, 2U);
}

TEST_F(Bags, EachMessageIsARowOfEachQuantity) {
  judged_mcap(
      mcap(schema(1, "sensor_msgs/msg/Imu") + channel(1, 1, "/a") + message(1, {start}, stamped(start - ms)) +
           message(1, {start + 10 * ms}, stamped(start)) + message(1, {start + 12 * ms}, stamped(0)) +
           message(1, {start + 15 * ms}, stamped(start + 15 * ms))),
      {.deadline = 5ms, .period = {}, .age = 5ms});
  EXPECT_THAT(values_of(period), ElementsAre(10 * ms, 2 * ms, 3 * ms));
  EXPECT_THAT(values_of(age), ElementsAre(ms, 10 * ms, 0));
  const auto is_late = [&](listen::Row::Quantity quantity) {
    std::vector<bool> late;
    for (const auto& row : rows_)
      if (row.quantity == quantity) late.push_back(row.is_late);
    return late;
  };
  EXPECT_THAT(is_late(period), ElementsAre(true, false, false));
  EXPECT_THAT(is_late(age), ElementsAre(false, true, false));
  // By a clock of their own, which begins with the bag.
  for (const auto& row : rows_) EXPECT_LT(std::abs(row.to_ns), 2000 * ms);
}

TEST_F(Bags, ClockThatIsSetDuringARecordingIsLeftOut) {
  judged_mcap(mcap(channel(1, 0, "/a") + message(1, {ms}) + message(1, {3 * ms}) + message(1, {start}) +
                   message(1, {start + ms})));
  EXPECT_THAT(values_of(period), ElementsAre(2 * ms, ms));
  EXPECT_LT(rows_.back().to_ns, 2000 * ms);
}

TEST_F(Bags, WriterThatBeginsAnewLosesNothing) {
  const auto findings =
      judged_mcap(mcap(channel(1, 0, "/a") + message(1, {start, -1, 100'000}) + message(1, {start, -1, 1}) +
                       message(1, {start, -1, 2}) + message(1, {start, -1, 4'000'000'000})));
  EXPECT_EQ(findings.flows.at(0).lost, 0U);
  EXPECT_EQ(findings.flows.at(0).messages, 4U);
}

TEST_F(Bags, NumberFarFromTheOneBeforeMakesNoRowsOfLoss) {
  judged_mcap(mcap(channel(1, 0, "/a") + message(1, {start + ms, start, 0}) +
                   message(1, {start + ms, start, 4'000'000'000}) +
                   message(1, {start + ms, 0, 4'000'000'001}) + message(1, {start + ms, start, 7})));
  EXPECT_THAT(values_of(age), ElementsAre(ms, ms, ms));
}

TEST_F(Bags, StampsTellTheOrderWithoutNumbers) {
  const auto findings = judged_mcap(mcap(schema(1, "sensor_msgs/msg/Imu") + channel(1, 1, "/a") +
                                         message(1, {start + 2 * ms}, stamped(start + ms)) +
                                         message(1, {start + 3 * ms}, stamped(start))));
  EXPECT_EQ(findings.flows.at(0).reordered, 1U);
}

TEST_F(Bags, ChannelsOfOneTopicAreJudgedApart) {
  const auto findings =
      judged_mcap(mcap(channel(4, 0, "/a") + channel(5, 0, "/a") + channel(4, 0, "/a") + message(4, {start}) +
                       message(5, {start + ms}) + message(4, {start + 10 * ms})));
  ASSERT_EQ(findings.flows.size(), 2U);
  EXPECT_EQ(findings.flows[0].period.max_ns(), 10 * ms);
  EXPECT_NE(findings.flows[0].writer, findings.flows[1].writer);
}

TEST_F(Bags, SilentTopicIsReported) {
  const auto findings = judged_mcap(mcap(channel(1, 0, "/a") + channel(2, 0, "/b") + message(1, {start}) +
                                         message(2, {start}) + message(2, {start + 100 * ms})),
                                    {.deadline = 50ms, .period = {}, .age = {}});
  EXPECT_EQ(findings.flows.at(0).silent_ns, 100 * ms);
  EXPECT_EQ(findings.flows.at(1).silent_ns, 0);
}

}  // namespace
}  // namespace ontime::bag

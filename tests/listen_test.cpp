// SPDX-License-Identifier: Apache-2.0
#include "listen/listen.hpp"

#include <algorithm>
#include <fstream>
#include <functional>
#include <map>

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <unistd.h>

#include "listen/library.hpp"
#include "listen/messages.hpp"
#include "listen/processes.hpp"
#include "listen/sequence.hpp"

namespace ontime::listen {
namespace {

using namespace std::chrono_literals;

TEST(Distribution, QuantilesAreWithinTheirBounds) {
  Distribution values;
  for (std::int64_t i = 1; i <= 100'000; ++i) values.add(i * 1000);
  EXPECT_EQ(values.count(), 100'000U);
  EXPECT_EQ(values.max_ns(), 100'000'000);
  EXPECT_NEAR(static_cast<double>(values.quantile_ns(0.5)), 50e6, 50e6 * 0.016);
  EXPECT_NEAR(static_cast<double>(values.quantile_ns(0.99)), 99e6, 99e6 * 0.016);
  EXPECT_EQ(values.quantile_ns(1), 100'000'000);
}

TEST(Distribution, CountsOfMonthsAreHeld) {
  Distribution values;
  values.add(1000);
  values.add(2000);
  for (int i = 0; i < 33; ++i) values.add(Distribution(values));  // twice as many each time
  EXPECT_EQ(values.count(), std::uint64_t{1} << 34);
  EXPECT_EQ(values.count_up_to(1500), std::uint64_t{1} << 33);
}

TEST(Distribution, ExtremeValuesAreKept) {
  Distribution values;
  EXPECT_EQ(values.quantile_ns(0.5), 0);
  values.add(-5);
  EXPECT_EQ(values.max_ns(), 0);
  values.add(INT64_MAX);
  EXPECT_EQ(values.max_ns(), INT64_MAX);
  EXPECT_EQ(values.quantile_ns(0.5), 0);
}

TEST(Sequence, GapIsLostUntilItIsFilled) {
  Sequence sequence;
  EXPECT_EQ(sequence.see(10), Sequence::Fate::in_order);
  EXPECT_EQ(sequence.see(13), Sequence::Fate::in_order);
  EXPECT_EQ(sequence.lost(), 2U);
  EXPECT_EQ(sequence.see(11), Sequence::Fate::overtaken);
  EXPECT_EQ(sequence.see(11), Sequence::Fate::again);
  EXPECT_EQ(sequence.see(9), Sequence::Fate::too_old);
  EXPECT_EQ(sequence.lost(), 1U);
}

TEST(Sequence, LossLongerThanTheWindowIsCountedWhole) {
  Sequence sequence;
  sequence.see(1);
  sequence.see(3);
  sequence.see(20'003);
  EXPECT_EQ(sequence.lost(), 1U + 19'999U);
  EXPECT_EQ(sequence.see(20'002), Sequence::Fate::overtaken);
  EXPECT_EQ(sequence.lost(), 19'999U);
  EXPECT_EQ(sequence.see(3), Sequence::Fate::too_old);
}

TEST(Sequence, AnnouncedNumbersAreMissingUntilSeen) {
  Sequence sequence;
  sequence.announce(5);  // before the first: of what was there before nothing is known
  sequence.see(6);
  sequence.announce(8);
  EXPECT_EQ(sequence.lost(), 2U);
  EXPECT_EQ(sequence.see(7), Sequence::Fate::overtaken);
  sequence.announce(8);
  EXPECT_EQ(sequence.lost(), 1U);
}

TEST(Sequence, NumbersPassedOverAreNotLost) {
  Sequence sequence;
  sequence.see(1);
  sequence.see(4);
  sequence.pass_over(2, 2);
  EXPECT_EQ(sequence.lost(), 1U);
  sequence.pass_over(5, 9'999);
  EXPECT_EQ(sequence.see(10'000), Sequence::Fate::in_order);
  EXPECT_EQ(sequence.lost(), 1U);
  sequence.pass_over(10'003, 10'003);
  EXPECT_EQ(sequence.lost(), 3U);
}

TEST(Sequence, RestartKeepsWhatIsLost) {
  Sequence sequence;
  sequence.see(1);
  sequence.see(3);
  sequence.restart();
  EXPECT_EQ(sequence.see(100), Sequence::Fate::in_order);
  EXPECT_EQ(sequence.lost(), 1U);
}

// A publisher in process 1 and a subscription in process 2, on one topic.
class OnePair : public testing::Test {
 protected:
  OnePair() : OnePair(Limits{}) {}
  explicit OnePair(const Limits& limits) : messages(limits) {
    messages.begin_process(1, "controller");
    messages.begin_process(2, "base");
    messages.name_topic(1, 0xa, "/cmd_vel");
    messages.name_topic(2, 0xb, "/cmd_vel");
  }

  void publish(std::int64_t at_ns, std::uint32_t process = 1, std::uint64_t endpoint = 0xa) {
    messages.add(
        {.kind = Observation::Kind::published, .at_ns = at_ns, .endpoint = endpoint, .process = process});
  }
  void take(std::int64_t at_ns, std::int64_t stamp_ns, bool after_loss = false) {
    messages.add({.kind = Observation::Kind::taken,
                  .after_loss = after_loss,
                  .at_ns = at_ns,
                  .stamp_ns = stamp_ns,
                  .endpoint = 0xb,
                  .process = 2,
                  .writer = {7}});
  }
  // Published and taken 50 µs later, stamped in between.
  void arrive(std::int64_t at_ns) {
    publish(at_ns);
    take(at_ns + 50'000, at_ns + 2'000);
  }
  void get_acquainted() {
    for (int i = -100; i < 10; ++i) arrive(at(i));  // longer than a second
  }
  static std::int64_t at(int i) { return 2'000'000'000 + std::int64_t{i} * 10'000'000; }
  Flow flow() const { return messages.findings().flows.at(0); }

  Messages messages;
};

TEST_F(OnePair, MessagesInOrderMakeOneFlow) {
  get_acquainted();
  ASSERT_EQ(messages.findings().flows.size(), 1U);
  EXPECT_EQ(flow().topic, "/cmd_vel");
  EXPECT_EQ(flow().writer, (Party{1, "controller"}));
  EXPECT_EQ(flow().reader, (Party{2, "base"}));
  EXPECT_EQ(flow().messages, 110U);
  EXPECT_EQ(flow().lost, 0U);
  EXPECT_NEAR(flow().rate_hz(), 100, 1e-6);
  ASSERT_TRUE(flow().age);
  EXPECT_EQ(flow().age->max_ns(), 48'000);
}

TEST_F(OnePair, MessageNeverTakenIsLost) {
  get_acquainted();
  publish(at(10));
  publish(at(11));
  arrive(at(12));
  EXPECT_EQ(flow().lost, 2U);
  EXPECT_EQ(flow().messages, 111U);
}

TEST_F(OnePair, MessagesOfAPauseCountNowhere) {
  get_acquainted();
  const auto ages = flow().age->count();
  publish(at(10));
  messages.interrupt(at(30));
  for (int i = 10; i < 30; ++i) take(at(30) + i, at(i) + 2'000);
  for (int i = 31; i < 40; ++i) arrive(at(i));
  EXPECT_EQ(flow().lost, 0U);
  EXPECT_EQ(flow().duplicated + flow().reordered, 0U);
  ASSERT_TRUE(flow().age);
  EXPECT_EQ(flow().age->count(), ages + 9);
  EXPECT_EQ(flow().age->max_ns(), 48'000);
  publish(at(40));
  arrive(at(41));
  EXPECT_EQ(flow().lost, 1U);
}

TEST_F(OnePair, RateIsThatOfTheTimeThatWasListenedTo) {
  get_acquainted();
  messages.interrupt(at(1000));
  for (int i = 1001; i < 1010; ++i) arrive(at(i));
  EXPECT_NEAR(flow().rate_hz(), 100, 1e-6);
}

TEST_F(OnePair, MessageTakenLateIsOutOfOrderAndNotLost) {
  get_acquainted();
  publish(at(10));
  arrive(at(11));
  take(at(11) + 100'000, at(10) + 2'000);
  EXPECT_EQ(flow().lost, 0U);
  EXPECT_EQ(flow().reordered, 1U);
}

TEST_F(OnePair, SameStampTwiceIsADuplicate) {
  get_acquainted();
  take(at(9) + 60'000, at(9) + 2'000);
  EXPECT_EQ(flow().duplicated, 1U);
  EXPECT_EQ(flow().lost, 0U);
}

TEST_F(OnePair, TwoStampsOfOnePublishAreNoDuplicate) {
  get_acquainted();
  take(at(9) + 60'000, at(9) + 3'000);
  EXPECT_EQ(flow().duplicated, 0U);
}

TEST_F(OnePair, TwoPublishesAtOnceAreNotLost) {
  get_acquainted();
  publish(at(10));
  publish(at(10) + 5'000);
  take(at(10) + 50'000, at(10) + 6'000);
  take(at(10) + 60'000, at(10) + 7'000);
  EXPECT_EQ(flow().lost, 0U);
  EXPECT_EQ(flow().duplicated, 0U);
  take(at(10) + 70'000, at(10) + 7'000);
  EXPECT_EQ(flow().duplicated, 1U);
}

TEST_F(OnePair, WriterIsUnknownAgainWhenItsStampsNoLongerFit) {
  get_acquainted();
  publish(at(10));
  arrive(at(11));
  ASSERT_EQ(flow().lost, 1U);
  for (int i = 12; i < 140; ++i) {
    publish(at(i));
    take(at(i) + 6'000'000, at(i) + 5'000'000);
  }
  for (const auto& one : messages.findings().flows)
    if (one.reader.process == 2) {
      EXPECT_EQ(one.writer, Party{});
      EXPECT_FALSE(one.lost);
    }
}

TEST_F(OnePair, DelayedStampDoesNotHideTheWriter) {
  for (int i = 0; i < 300; ++i) {
    publish(at(i));
    take(at(i) + 900'000, at(i) + (i % 20 == 5 ? 800'000 : 2'000));
  }
  EXPECT_EQ(flow().writer.process, 1U);
  EXPECT_EQ(flow().lost, 0U);
}

TEST_F(OnePair, StampsThatAreDelayedForHalfASecondDoNotHideTheWriter) {
  const auto arrive_at = [&](std::int64_t now, std::int64_t stamp_after) {
    publish(now);
    take(now + 150'000, now + stamp_after);
  };
  for (int i = 0; i < 10'000; ++i)  // on a busy machine eight in a row are soon delayed
    arrive_at(at(0) + std::int64_t{i} * 200'000, i >= 6'000 && i < 8'500 ? 120'000 : 2'000);
  EXPECT_EQ(flow().writer.process, 1U);
  ASSERT_TRUE(flow().age);
  EXPECT_GT(flow().age->count(), 4'900U) << "all since the writer was recognized";
  EXPECT_EQ(flow().lost, 0U);
}

TEST_F(OnePair, FastRemoteWriterIsNotTakenForALocalOne) {
  for (int i = 0; i < 20'000; ++i) {
    const auto now = at(0) + std::int64_t{i} * 500'000;
    publish(now);
    take(now + 450'000, now + (std::int64_t{i} * 7'919 % 400) * 1'000);
  }
  for (const auto& one : messages.findings().flows)
    EXPECT_TRUE(one.reader.process != 2 || one.writer == Party{});
}

TEST_F(OnePair, NothingIsLostAcrossALossOfTheSensor) {
  get_acquainted();
  publish(at(10));
  publish(at(11));
  messages.add({.kind = Observation::Kind::published,
                .after_loss = true,
                .at_ns = at(12),
                .endpoint = 0xa,
                .process = 1});
  take(at(12) + 50'000, at(12) + 2'000);
  EXPECT_EQ(flow().lost, 0U);
  EXPECT_EQ(flow().period.count(), 109U);
}

TEST_F(OnePair, WriterOfAnotherMachineHasNoAgeAndNoLoss) {
  for (int i = 0; i < 20; ++i) take(at(i), at(i) - 3'000'000);
  ASSERT_EQ(messages.findings().flows.size(), 1U);
  EXPECT_EQ(flow().writer, Party{});
  EXPECT_FALSE(flow().age);
  EXPECT_FALSE(flow().lost);
}

TEST_F(OnePair, RemoteStampsBetweenLocalPublishesAreNotTakenForThem) {
  for (int i = 0; i < 1000; ++i) {
    publish(at(i));
    take(at(i) + 5'000'000,
         at(i) + (i * 7'919 % 10'000) * 1'000);  // of another writer: anywhere in the period
  }
  for (const auto& one : messages.findings().flows)
    EXPECT_TRUE(one.reader.process != 2 || one.writer == Party{});
}

TEST_F(OnePair, EachOfTwoPublishersFindsItsOwnReader) {
  messages.name_topic(3, 0xc, "/cmd_vel");
  for (int i = 0; i < 120; ++i) {
    arrive(at(i));
    publish(at(i) + 5'000'000, 3, 0xc);
    messages.add({.kind = Observation::Kind::taken,
                  .at_ns = at(i) + 5'050'000,
                  .stamp_ns = at(i) + 5'001'000,
                  .endpoint = 0xb,
                  .process = 2,
                  .writer = {8}});
  }
  const auto flows = messages.findings().flows;
  ASSERT_EQ(flows.size(), 2U);
  EXPECT_EQ(flows[0].writer.process, 1U);
  EXPECT_EQ(flows[1].writer.process, 3U);
  EXPECT_EQ(flows[0].lost, 0U);
  EXPECT_EQ(flows[1].lost, 0U);
}

TEST_F(OnePair, PublisherWithoutReaderIsListed) {
  publish(at(0));
  publish(at(1));
  ASSERT_EQ(messages.findings().flows.size(), 1U);
  EXPECT_EQ(flow().reader, Party{});
  EXPECT_EQ(flow().messages, 2U);
}

TEST_F(OnePair, AddressOfAnotherTopicBeginsAnew) {
  get_acquainted();
  messages.name_topic(2, 0xb, "/scan");
  take(at(10), at(10) - 1'000);
  std::map<std::string, std::uint64_t> by_topic;
  for (const auto& one : messages.findings().flows)
    if (one.reader.process == 2) by_topic[one.topic] += one.messages;
  EXPECT_EQ(by_topic, (std::map<std::string, std::uint64_t>{{"/cmd_vel", 110}, {"/scan", 1}}))
      << "what was counted of the topic before stays";
}

TEST_F(OnePair, TakeWithoutAStampOfAPublisherThatMadeRoomIsCounted) {
  get_acquainted();
  const auto taken = [&] {
    const auto flows = messages.findings().flows;
    const auto one = std::find_if(flows.begin(), flows.end(), [](const auto& flow) {
      return flow.reader == Party{2, "base"};
    });
    return one == flows.end() ? 0 : one->messages;
  };
  const auto before = taken();
  for (std::uint64_t i = 0; i < Messages::most_live; ++i)
    publish(at(7000) + static_cast<std::int64_t>(i), 1, 0x1000 + i);
  take(at(7001), 0);
  EXPECT_EQ(taken(), before + 1);
}

TEST_F(OnePair, StampAfterTheTakeIsNoAge) {
  get_acquainted();
  const auto ages = flow().age->count();
  publish(at(10));
  take(at(10) + 50'000, at(100));  // the clock was set back in between
  EXPECT_EQ(flow().age->count(), ages);
}

TEST(Probing, TimeBetweenTwoIsNoneOfThem) {
  Probing probing;
  probing.add(0, 1'000'000);
  probing.add(6'000'000, 7'000'000);
  const auto is_beyond = [](std::int64_t ns) { return ns > 15'000'000; };
  EXPECT_EQ(probing.judge(0, 20'000'000, is_beyond), Probing::Verdict::late);
  EXPECT_EQ(probing.judge(0, 16'000'000, is_beyond), Probing::Verdict::not_judged);
}

// Which message a take belongs to is not known where its publish may be among the lost events.
TEST(ChainAfterALoss, DoesNotBeginWithAnEarlierMessage) {
  constexpr std::int64_t ms = 1'000'000;
  Messages messages({}, {{.steps = {{"/scan"}, {"/map"}}, .age = 5ms}});
  for (const std::uint32_t process : {1U, 2U, 3U}) messages.begin_process(process, "node");
  messages.name_topic(1, 0xa, "/scan");
  messages.name_topic(2, 0xa, "/scan");
  messages.name_topic(2, 0xb, "/map");
  messages.name_topic(3, 0xb, "/map");
  const auto publish = [&](std::uint32_t process, std::uint64_t endpoint, std::int64_t at_ns) {
    messages.add({.kind = Observation::Kind::published,
                  .at_ns = at_ns,
                  .endpoint = endpoint,
                  .process = process,
                  .thread = process});
  };
  const auto take = [&](std::uint32_t process, std::uint64_t endpoint, std::int64_t at_ns,
                        bool after_loss = false) {
    messages.add({.kind = Observation::Kind::taken,
                  .after_loss = after_loss,
                  .at_ns = at_ns,
                  .stamp_ns = at_ns - 48'000,
                  .endpoint = endpoint,
                  .process = process,
                  .thread = process,
                  .writer = {7}});
  };
  const auto pass = [&](std::int64_t at_ns, bool is_lost) {
    if (!is_lost) publish(1, 0xa, at_ns);
    take(2, 0xa, at_ns + 50'000, is_lost);
    publish(2, 0xb, at_ns + 60'000);
    take(3, 0xb, at_ns + 110'000);
  };
  for (int i = 100; i < 300; ++i) pass(i * 10 * ms, false);
  const auto came_out = [&] { return messages.findings().chains.at(0).paths.at(0).age.count(); };
  const auto before = came_out();
  EXPECT_GT(before, 50U);
  pass(3000 * ms, true);
  EXPECT_EQ(came_out(), before);
  pass(3010 * ms, false);
  EXPECT_EQ(came_out(), before + 1);
  EXPECT_EQ(messages.findings().chains.at(0).paths.at(0).late, 0U);
}

struct AgedPair : OnePair {
  AgedPair() : OnePair(Limits{.deadline = {}, .period = {}, .age = 1ms}) {}
};

TEST_F(AgedPair, PeriodsThatHaveNoLimitLeaveNoMessageUnjudged) {
  get_acquainted();
  messages.add_probing(at(9) + 100'000, at(10) - 100'000);
  arrive(at(10));
  EXPECT_EQ(flow().not_judged, 0U);
  EXPECT_EQ(flow().age->max_ns(), 48'000);
}

struct JudgedPair : OnePair {
  JudgedPair() : OnePair(Limits{.deadline = 15ms, .period = {}, .age = 1ms}) {}
};

TEST_F(JudgedPair, GapBeyondTheDeadlineIsLate) {
  get_acquainted();
  arrive(at(12));
  EXPECT_EQ(flow().late, 1U);
  const auto misses = messages.take_misses(at(100'000));
  ASSERT_EQ(misses.size(), 1U);
  EXPECT_EQ(misses[0].kind, Miss::Kind::gap);
  EXPECT_EQ(misses[0].value_ns, 30'000'000);
}

TEST_F(JudgedPair, AgeBeyondItsLimitIsLate) {
  get_acquainted();
  publish(at(10));
  take(at(10) + 3'000'000, at(10) + 2'000);
  EXPECT_EQ(flow().late, 1U);
  const auto misses = messages.take_misses(at(100'000));
  ASSERT_EQ(misses.size(), 1U);
  EXPECT_EQ(misses[0].kind, Miss::Kind::age);
  EXPECT_EQ(misses[0].value_ns, 2'998'000);
}

TEST_F(JudgedPair, MessageUnderWayWhileProbesAreSetIsNotJudged) {
  std::vector<Row> rows;
  messages.keep_rows([&](const Row& row) { rows.push_back(row); });
  get_acquainted();
  const auto before = flow();
  publish(at(10));
  rows.clear();
  messages.add_probing(at(10) + 100'000, at(12));
  take(at(12) + 100'000, at(10) + 2'000);
  EXPECT_EQ(flow().late, 0U);
  EXPECT_EQ(flow().not_judged, 1U);
  EXPECT_EQ(flow().period.count(), before.period.count());
  EXPECT_EQ(flow().age->count(), before.age->count());
  EXPECT_EQ(flow().messages, before.messages + 1);
  EXPECT_EQ(flow().lost, 0U);
  EXPECT_TRUE(messages.take_misses(at(13)).empty());
  EXPECT_TRUE(rows.empty());
  // What is late afterwards, and what is lost, counts.
  publish(at(13));
  publish(at(14));
  take(at(14) + 2'000'000, at(14) + 2'000);
  EXPECT_EQ(flow().late, 1U);
  EXPECT_EQ(flow().not_judged, 1U);
  EXPECT_EQ(flow().lost, 1U);
}

TEST_F(JudgedPair, LossWhileProbesAreSetIsNotJudged) {
  std::vector<Row> rows;
  messages.keep_rows([&](const Row& row) { rows.push_back(row); });
  get_acquainted();
  publish(at(10));  // overwritten by the next, while its reader is held up
  messages.add_probing(at(10) + 1'000'000, at(12));
  publish(at(11));
  publish(at(12) + 1'000);
  take(at(12) + 50'000, at(12) + 3'000);
  EXPECT_EQ(flow().lost, 0U);
  EXPECT_EQ(flow().lost_not_judged, 2U);
  publish(at(13));
  arrive(at(14));
  EXPECT_EQ(flow().lost, 1U);
  EXPECT_EQ(flow().lost_not_judged, 2U);
  EXPECT_EQ(std::ranges::count(rows, 0, &Row::to_ns), 1);
}

TEST_F(JudgedPair, GapThatIsTooLongWithoutTheProbesIsLate) {
  get_acquainted();
  messages.add_probing(at(10), at(10) + 1'000'000);
  arrive(at(13));
  EXPECT_EQ(flow().late, 1U);
  EXPECT_EQ(flow().not_judged, 0U);
}

TEST_F(JudgedPair, LossThatProbesMayExplainMayComeAfterAll) {
  get_acquainted();
  publish(at(10));
  messages.add_probing(at(10) + 100'000, at(11));
  publish(at(11) + 1'000);
  take(at(11) + 50'000, at(11) + 3'000);
  EXPECT_EQ(flow().lost, 0U);
  EXPECT_EQ(flow().lost_not_judged, 1U);
  take(at(11) + 60'000, at(10) + 2'000);
  EXPECT_EQ(flow().lost, 0U);
  EXPECT_EQ(flow().lost_not_judged, 0U);
  EXPECT_EQ(flow().reordered, 1U);
  EXPECT_EQ(flow().duplicated, 0U);
}

TEST_F(JudgedPair, WriterThatProbesHeldUpIsNotJudgedByItsPeriod) {
  publish(at(0), 1, 0xc);
  messages.add_probing(at(1), at(3));
  publish(at(3) + 1'000, 1, 0xc);
  publish(at(4), 1, 0xc);
  EXPECT_EQ(flow().late, 0U);
  EXPECT_EQ(flow().not_judged, 1U);
  publish(at(6), 1, 0xc);
  EXPECT_EQ(flow().late, 1U);
}

TEST_F(JudgedPair, MissBeforeTheTopicHasItsNameWaitsForIt) {
  constexpr std::uint64_t unnamed = 0xc;
  const auto take_unnamed = [&](std::int64_t at_ns) {
    messages.add({.kind = Observation::Kind::taken, .at_ns = at_ns, .endpoint = unnamed, .process = 2});
  };
  take_unnamed(at(0));
  take_unnamed(at(3));
  EXPECT_TRUE(messages.take_misses(at(4)).empty());
  messages.name_topic(2, unnamed, "/odom");
  EXPECT_THAT(messages.take_misses(at(4)), testing::ElementsAre(testing::Field(&Miss::topic, "/odom")));
  take_unnamed(at(6));
  EXPECT_EQ(messages.take_misses(at(7)).size(), 1U);
}

TEST_F(JudgedPair, MissOfAProcessThatJustBeganHasItsName) {
  const auto take_in_new = [&](std::int64_t at_ns) {
    messages.add({.kind = Observation::Kind::taken, .at_ns = at_ns, .endpoint = 0xd, .process = 3});
  };
  messages.name_topic(3, 0xd, "/odom");
  take_in_new(at(0));
  take_in_new(at(3));
  messages.begin_process(3, "navigation");
  const auto misses = messages.take_misses(at(4));
  ASSERT_EQ(misses.size(), 1U);
  EXPECT_EQ(misses[0].reader, (Party{3, "navigation"}));
}

TEST_F(JudgedPair, MissOfATopicWithoutANameIsToldAfterAWhile) {
  const auto take_unnamed = [&](std::int64_t at_ns) {
    messages.add({.kind = Observation::Kind::taken, .at_ns = at_ns, .endpoint = 0xc, .process = 2});
  };
  take_unnamed(at(0));
  take_unnamed(at(3));
  EXPECT_TRUE(messages.take_misses(at(3) + Messages::named_within_ns - 1).empty());
  EXPECT_EQ(messages.take_misses(at(3) + Messages::named_within_ns).size(), 1U);
}

TEST_F(JudgedPair, MemoryOfMissesIsBounded) {
  get_acquainted();
  for (int i = 0; i < 3000; ++i) arrive(at(20 + i * 5));
  EXPECT_EQ(messages.take_misses(at(100'000)).size(), most_misses);
  EXPECT_EQ(messages.findings().misses_left_out.at("/cmd_vel"), 2000U);
  EXPECT_EQ(flow().late, 3000U);
}

TEST_F(JudgedPair, FlowOfEndedProcessesStaysUntilThereAreTooMany) {
  constexpr auto most = static_cast<std::uint32_t>(Messages::most_ended);
  for (std::uint32_t process = 10; process < 10 + most + 5; ++process) {
    messages.begin_process(process, "node");
    messages.name_topic(process, 0xa, "/scan");
    publish(at(0), process);
    publish(at(1), process);
    messages.end_process(process, at(2));
  }
  messages.retire_ended(at(2) + Messages::still_taken_ns - 1);
  EXPECT_EQ(messages.findings().flows.size(), most + 5U) << "its last messages may still be taken";
  messages.retire_ended(at(2) + Messages::still_taken_ns);
  const auto findings = messages.findings();
  ASSERT_EQ(findings.flows.size(), most);
  EXPECT_EQ(findings.flows.back().writer, (Party{10 + most + 4, "node"}));
  EXPECT_EQ(findings.flows.back().topic, "/scan");
  EXPECT_EQ(findings.forgotten.flows, 5U);
  EXPECT_EQ(findings.forgotten.messages, 10U);
  EXPECT_EQ(findings.forgotten.with_misses, 5U) << "they fell silent, and a deadline is stated";
}

TEST_F(OnePair, EndedReaderIsOneFlowAndItsWriterNoOther) {
  get_acquainted();
  const auto id = flow().id;
  messages.end_process(2, at(10));
  messages.retire_ended(at(10) + Messages::still_taken_ns);
  ASSERT_EQ(messages.findings().flows.size(), 1U);
  EXPECT_EQ(flow().writer, (Party{1, "controller"}));
  EXPECT_EQ(flow().reader, (Party{2, "base"}));
  EXPECT_EQ(flow().messages, 110U);
  EXPECT_EQ(flow().id, id);
}

TEST_F(OnePair, SameProcessNumberIsAnotherProcess) {
  get_acquainted();
  messages.end_process(2, at(10));
  messages.begin_process(2, "another");
  for (int i = 11; i < 20; ++i) arrive(at(i));
  const auto flows = messages.findings().flows;
  ASSERT_EQ(flows.size(), 2U);
  EXPECT_NE(flows[0].reader.name, flows[1].reader.name);
  EXPECT_NE(flows[0].id, flows[1].id);
}

TEST_F(OnePair, PublishersBeyondTheBoundAreLeftOutUntilOthersAreIdle) {
  for (std::uint64_t endpoint = 1; endpoint <= Messages::most_live + 3; ++endpoint)
    publish(at(0), 1, 0x1000 + endpoint);
  auto findings = messages.findings();
  EXPECT_EQ(findings.flows.size(), Messages::most_live);
  EXPECT_EQ(findings.remarks.size(), 1U);
  publish(at(0) + Messages::idle_ns, 1, 0x9000);
  EXPECT_EQ(messages.findings().flows.size(), Messages::most_live + 1) << "the idle one's flow is kept";
}

// Of one writer and one reader on one topic, every 10 ms, each of which is taken 1 ms later but for these.
std::vector<Row> rows_of(int messages,
                         const std::function<std::vector<std::pair<int, std::int64_t>>(int)>& takes) {
  Messages judge({.deadline = 15ms, .period = {}, .age = 2ms});
  std::vector<Row> rows;
  judge.keep_rows([&](const Row& row) { rows.push_back(row); });
  judge.name_topic(1, 10, "/scan");
  judge.name_topic(2, 20, "/scan");
  const auto published_ns = [](int number) { return 1'000'000'000 + number * std::int64_t{10'000'000}; };
  for (int number = 0; number < messages; ++number) {
    judge.add(
        {.kind = Observation::Kind::published, .at_ns = published_ns(number), .endpoint = 10, .process = 1});
    for (const auto& [of, after_ns] : takes(number))
      judge.add({.kind = Observation::Kind::taken,
                 .at_ns = published_ns(number) + after_ns,
                 .stamp_ns = published_ns(of) + 1000,
                 .endpoint = 20,
                 .process = 2,
                 .writer = {7}});
  }
  return rows;
}

std::vector<Row> ages_of(const std::vector<Row>& rows) {
  std::vector<Row> ages;
  std::copy_if(rows.begin(), rows.end(), std::back_inserter(ages),
               [](const Row& row) { return row.quantity == Row::Quantity::age; });
  return ages;
}

TEST(Rows, OfEveryMessageAreNumberedWithoutHoles) {
  const auto rows = rows_of(400, [](int number) {
    return std::vector{std::pair{number, std::int64_t{1'000'000}}};
  });
  std::map<std::uint64_t, std::vector<Row>> periods;  // of the publisher, and of the reader
  for (const auto& row : rows)
    if (row.quantity == Row::Quantity::period) periods[row.flow].push_back(row);
  ASSERT_EQ(periods.size(), 2U);
  for (const auto& [flow, of] : periods) {
    ASSERT_EQ(of.size(), 399U);
    for (std::size_t i = 0; i < of.size(); ++i) {
      EXPECT_EQ(of[i].index, i);
      EXPECT_EQ(of[i].to_ns - of[i].from_ns, 10'000'000);
      EXPECT_FALSE(of[i].is_late);
    }
  }
  const auto ages = ages_of(rows);
  ASSERT_GT(ages.size(), 200U);
  for (std::size_t i = 0; i < ages.size(); ++i) {
    EXPECT_EQ(ages[i].index, i);
    EXPECT_EQ(ages[i].to_ns - ages[i].from_ns, 999'000);
  }
}

TEST(Rows, LossStandsWhereItsMessageWouldAndGoesWhenItComesAfterAll) {
  const auto rows = ages_of(rows_of(400, [](int number) -> std::vector<std::pair<int, std::int64_t>> {
    if (number == 300 || number == 350) return {};
    if (number == 352) return {{352, 1'000'000}, {350, 3'000'000}};  // 350 was overtaken
    return {{number, 1'000'000}};
  }));
  std::map<std::uint64_t, Row> last;  // what a results file keeps
  for (const auto& row : rows) last[row.index] = row;
  std::vector<std::int64_t> lost, late;
  for (const auto& [index, row] : last) {
    const auto number = (row.from_ns - 1'000'000'000) / 10'000'000;
    EXPECT_EQ(number - static_cast<std::int64_t>(index), (rows.front().from_ns - 1'000'000'000) / 10'000'000);
    if (row.to_ns == 0) lost.push_back(number);
    if (row.is_late) late.push_back(number);
  }
  EXPECT_THAT(lost, ::testing::ElementsAre(300));
  EXPECT_THAT(late, ::testing::ElementsAre(350));
}

TEST(Rows, LossesBeyondTheWindowHaveNone) {
  Rows rows;
  std::vector<Row> kept;
  const KeepRow keep = [&](const Row& row) { kept.push_back(row); };
  const auto lost_at = [](std::uint64_t) { return std::int64_t{5}; };
  rows.age(keep, {.flow = 1, .from_ns = 1, .to_ns = 2}, 7, lost_at);
  rows.age(keep, {.flow = 1, .from_ns = 3, .to_ns = 4}, 7'000'007, lost_at);
  ASSERT_EQ(kept.size(), Sequence::window + 2);
  EXPECT_EQ(kept[1].to_ns, 0);
  EXPECT_EQ(kept.back().index, 7'000'000U);
  EXPECT_EQ(kept.back().to_ns, 4);
}

TEST(Silence, OfAWriterThatDiedIsBeyondItsLimit) {
  std::vector<Flow> flows(2);
  flows[0].last_ns = 1'000'000'000;
  flows[1].last_ns = 5'990'000'000;
  judge_silence(flows, Limits{.deadline = 15ms, .period = {}, .age = {}}, 6'000'000'000);
  EXPECT_EQ(flows[0].silent_ns, 5'000'000'000);
  EXPECT_EQ(flows[1].silent_ns, 0);
  flows[0].silent_ns = 0;
  judge_silence(flows, Limits{}, 6'000'000'000);
  EXPECT_EQ(flows[0].silent_ns, 0) << "no limit was stated";
  judge_silence(flows, Limits{.deadline = 15ms, .period = {}, .age = {}}, 6'000'000'000, 5'900'000'000);
  EXPECT_EQ(flows[0].silent_ns, 100'000'000) << "before that, nothing listened";
}

// A node that starts again is another process.
TEST(Silence, EndsWhereAFlowOfTheSameNamesBegins) {
  std::vector<Flow> flows(3);
  for (auto& flow : flows) {
    flow.topic = "/cmd_vel";
    flow.writer = {1, "controller"};
    flow.reader = {2, "base"};
  }
  const auto judged = [&](std::int64_t first_ns) {
    flows[0].first_ns = 0;
    flows[0].last_ns = 1'000'000'000;
    flows[1].writer.process = 7;
    flows[1].first_ns = first_ns;
    flows[1].last_ns = 60'000'000'000;
    flows[2].topic = "/scan";
    flows[2].first_ns = 1'001'000'000;
    flows[2].last_ns = 60'000'000'000;
    auto all = flows;
    judge_silence(all, Limits{.deadline = 15ms, .period = {}, .age = {}}, 60'000'000'000);
    return all[0];
  };
  EXPECT_EQ(judged(3'000'000'000).silent_ns, 2'000'000'000);
  EXPECT_TRUE(judged(3'000'000'000).was_replaced);
  EXPECT_EQ(judged(1'010'000'000).silent_ns, 0) << "in time";
  EXPECT_EQ(judged(500'000'000).silent_ns, 59'000'000'000) << "it was there before";
}

TEST(Period, HalfAsMuchAgainIsNoGap) {
  const Limits limits{.deadline = {}, .period = 10ms, .age = {}};
  EXPECT_FALSE(limits.is_gap(15'000'000));
  EXPECT_TRUE(limits.is_gap(15'000'001));
}

TEST(Mapping, CodeOfAMiddlewareIsFound) {
  const auto found = mapping_of(
      "7f0010002000-7f0010082000 r-xp 00002000 fd:01 1234                       "
      "/opt/ros/humble/lib/librmw_cyclonedds_cpp.so",
      42);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->middleware, Middleware::rmw);
  EXPECT_EQ(found->name, "librmw_cyclonedds_cpp.so");
  EXPECT_EQ(found->path, "/proc/42/map_files/7f0010002000-7f0010082000");
  EXPECT_EQ(found->file.second, 1234U);
}

// Another user's process decides what it maps, and when.
TEST(Mapping, FileStaysTheOneThatWasFound) {
  if (access("/proc/self/map_files", X_OK) != 0 || getuid() != 0)
    GTEST_SKIP() << "only root may open what others map";
  const std::string path = testing::TempDir() + "/libddsc.so", other = testing::TempDir() + "/other";
  std::ofstream(path) << "the first";
  std::ofstream(other) << "another";
  const auto map = [](const std::string& name, void* at) {
    const int fd = open(name.c_str(), O_RDONLY | O_CLOEXEC);
    auto* const mapped =
        mmap(at, 4096, PROT_READ | PROT_EXEC, MAP_PRIVATE | (at != nullptr ? MAP_FIXED : 0), fd, 0);
    close(fd);
    return mapped;
  };
  auto* const mapped = map(path, nullptr);
  ASSERT_NE(mapped, MAP_FAILED);
  const auto change = Processes().look();
  const auto self = std::ranges::find(change.came, static_cast<std::uint32_t>(getpid()), &Process::id);
  ASSERT_NE(self, change.came.end());
  const auto library = std::ranges::find(self->libraries, "libddsc.so", &Mapping::name);
  ASSERT_NE(library, self->libraries.end());
  EXPECT_EQ(map(other, mapped), mapped);
  std::string text;
  std::getline(std::ifstream(library->path), text);
  EXPECT_EQ(text, "the first");
  munmap(mapped, 4096);
}

TEST(Mapping, RemovedFileIsFoundToo) {
  const auto found = mapping_of("7f00-7f10 r-xp 00002000 08:01 9 /usr/lib/libddsc.so.0.10.2 (deleted)", 1);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->middleware, Middleware::cyclonedds);
  EXPECT_EQ(found->name, "libddsc.so.0.10.2");
}

TEST(Mapping, AnythingElseIsNone) {
  EXPECT_FALSE(mapping_of("7f00-7f10 r--p 00002000 08:01 9 /usr/lib/libddsc.so.0.10.2", 1));  // no code
  EXPECT_FALSE(mapping_of("7f00-7f10 r-xp 00002000 08:01 9 /usr/lib/librmw_implementation.so", 1));
  EXPECT_FALSE(mapping_of("7f00-7f10 r-xp 00000000 00:00 0", 1));
  EXPECT_FALSE(mapping_of("7f00-7f10 r-xp 00000000 00:00 0 [vdso]", 1));
  EXPECT_FALSE(mapping_of("", 1));
}

TEST(RosName, OnlyTheTopicsPrefixGoes) {
  EXPECT_EQ(ros_name("rt/cmd_vel"), "/cmd_vel");
  EXPECT_EQ(ros_name("cmd_vel"), "cmd_vel");
  EXPECT_EQ(ros_name("rq/service"), "rq/service");
}

TEST(LibraryFile, OfAnotherKindIsRefused) {
  EXPECT_THROW(Library("/proc/self/maps"), Error);
  EXPECT_THROW(Library("/nonexistent"), Error);
}

// Such as one of a process that has ended: its architecture is unknown then.
TEST(LibraryFile, ThatCannotBeReadIsRefusedWithTheReason) {
  try {
    Library("/nonexistent");
    FAIL();
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), ::testing::HasSubstr("No such file"));
  }
}

TEST(LibraryFile, FunctionThatIsNotThereHasNoPlace) {
  EXPECT_FALSE(Library("/proc/self/exe").exit("rmw_publish"));
}

}  // namespace
}  // namespace ontime::listen

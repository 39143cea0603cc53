// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "listen/messages.hpp"
#include "listen_pair.hpp"

namespace ontime::listen {
namespace {

using namespace std::chrono_literals;

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

TEST_F(OnePair, RateIgnoresPauses) {
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

TEST(RosName, TopicsOfRos2ItselfAreKnown) {
  for (const char* own : {"rt/rosout", "rt/parameter_events", "ros_discovery_info", "DCPSParticipant"})
    EXPECT_TRUE(is_own_of_ros(ros_name(own))) << own;
  for (const char* robots : {"rt/cmd_vel", "rt/robot/rosout_agg", "cmd_vel", ""})
    EXPECT_FALSE(is_own_of_ros(ros_name(robots))) << robots;
}

class LatePair : public OnePair {
 protected:
  LatePair() : OnePair(Limits{.deadline = 25ms, .period = {}, .age = {}}) {}
};

TEST_F(LatePair, LateMessageWithoutAReaderIsAMissOfItsPublisher) {
  for (int i = 0; i < 10; ++i) publish(at(i));
  publish(at(14));
  const auto misses = messages.take_misses(at(14));
  ASSERT_EQ(misses.size(), 1U);
  const auto& miss = misses.front();
  EXPECT_EQ(miss.kind, Miss::Kind::gap);
  EXPECT_EQ(miss.topic, "/cmd_vel");
  EXPECT_EQ(miss.writer, (Party{1, "controller"}));
  EXPECT_EQ(miss.reader, Party{});
  EXPECT_EQ(miss.at_ns, at(14));
  EXPECT_EQ(miss.value_ns, at(14) - at(9));
  EXPECT_EQ(miss.flow, flow().id);
  EXPECT_EQ(miss.course.before_ns, at(9));
  EXPECT_EQ(miss.course.usual_ns, at(1) - at(0));
  EXPECT_EQ(flow().late, misses.size());
}

TEST_F(LatePair, LateMessageWithAReaderIsOneMiss) {
  for (int i = 0; i < 10; ++i) arrive(at(i));
  arrive(at(14));  // its writer is not recognized yet
  get_acquainted();
  arrive(at(14));
  for (const auto& miss : messages.take_misses(at(14))) EXPECT_EQ(miss.reader.process, 2U);
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

TEST(Probing, TimeBetweenTwoProbingsIsJudged) {
  Probing probing;
  probing.add(0, 1'000'000);
  probing.add(6'000'000, 7'000'000);
  const auto is_beyond = [](std::int64_t ns) { return ns > 15'000'000; };
  EXPECT_EQ(probing.judge(0, 20'000'000, is_beyond), Probing::Verdict::late);
  EXPECT_EQ(probing.judge(0, 16'000'000, is_beyond), Probing::Verdict::not_judged);
}

// Which message a take belongs to is not known where its publish may be among the lost events.
TEST(ChainAfterALoss, EarlierMessageBeginsNoChain) {
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

TEST_F(OnePair, EndedReaderAndItsWriterStayOneFlow) {
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

}  // namespace
}  // namespace ontime::listen

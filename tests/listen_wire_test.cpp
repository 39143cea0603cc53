// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "listen_on_the_wire.hpp"

namespace ontime::listen {
namespace {

using namespace std::chrono_literals;

TEST_F(OnTheWire, DataOfAnnouncedWriterHasItsTopic) {
  arrive(Rtps().announce("rt/cmd_vel"), "239.255.0.1:7400");
  for (unsigned i = 1; i <= 5; ++i) arrive(Rtps().stamp(1000, 0).data(i));
  ASSERT_EQ(wire.findings().flows.size(), 1U);
  EXPECT_EQ(flow().topic, "/cmd_vel");
  EXPECT_EQ(flow().messages, 5U);
  EXPECT_EQ(flow().lost, 0U);
  EXPECT_EQ(flow().writer.name, "01020304.05060708.090a0b0c:00001203 at 10.0.0.1:4000");
  EXPECT_EQ(flow().reader.name, "10.0.0.2:7411");
  EXPECT_NEAR(flow().rate_hz(), 100, 1e-6);
  EXPECT_FALSE(flow().age);  // two hosts, two clocks
}

TEST_F(OnTheWire, MissingNumbersAreLost) {
  arrive(Rtps().data(1));
  arrive(Rtps().data(4));
  EXPECT_EQ(flow().lost, 2U);
  arrive(Rtps().data(3));
  EXPECT_EQ(flow().lost, 1U);
  EXPECT_EQ(flow().reordered, 1U);
  EXPECT_EQ(flow().messages, 3U);
}

TEST_F(OnTheWire, CopyToAnotherReaderIsNoDuplicate) {
  arrive(Rtps().data(1));
  arrive(Rtps().data(1), "10.0.0.3:7411");
  arrive(Rtps().data(2));
  arrive(Rtps().data(2), "10.0.0.3:7411");
  EXPECT_EQ(flow().messages, 2U);
  EXPECT_EQ(flow().duplicated, 0U);
  EXPECT_EQ(flow().reader.name, "10.0.0.2:7411 and 1 more");
  arrive(Rtps().data(2));
  EXPECT_EQ(flow().duplicated, 1U);
}

TEST_F(OnTheWire, NumbersInAGapAreNotLost) {
  arrive(Rtps().data(1));
  arrive(Rtps().gap(2, 4, 2, 0x40000000));  // 2, 3 and 5
  arrive(Rtps().data(6));
  EXPECT_EQ(flow().lost, 1U);  // 4
}

TEST_F(OnTheWire, NumbersInALongGapAreNotLost) {
  arrive(Rtps().data(1));
  arrive(Rtps().heartbeat(1, 100));
  arrive(Rtps().gap(2, 6000, 0, 0));
  arrive(Rtps().data(6000));
  EXPECT_EQ(flow().lost, 0U);
}

// Cyclone DDS tells a new reader that it sends nothing of its history.
TEST_F(OnTheWire, GapForANewReaderClearsNoLossOfAnother) {
  arrive(Rtps().announce("rt/scan"));
  arrive(Rtps().announce_reader("rt/scan"));
  arrive(Rtps().data(1).data(3));
  arrive(Rtps().announce_reader("rt/scan", 2));
  arrive(Rtps().gap(1, 5, 0, 0));
  arrive(Rtps().data(5));
  EXPECT_EQ(flow().lost, 1U);  // 2
  arrive(Rtps().gap(6, 7, 0, 0));
  arrive(Rtps().data(7));
  EXPECT_EQ(flow().lost, 1U);
  wire.set_clock(0, 0);
  arrive(Rtps().data(1));
  arrive(Rtps().gap(2, 3, 0, 0));
  arrive(Rtps().data(3));
  EXPECT_EQ(flow().lost, 1U);
}

// Its announcement passes the point of capture some messages before it reaches the writer.
TEST_F(OnTheWire, GapForAReaderThatItsWriterKnowsLaterClearsNoLossOfAnother) {
  arrive(Rtps().announce("rt/scan"));
  arrive(Rtps().announce_reader("rt/scan"));
  arrive(Rtps().data(1));
  arrive(Rtps().announce_reader("rt/scan", 2));
  arrive(Rtps().data(2).data(4));
  arrive(Rtps().gap(1, 5, 0, 0));
  arrive(Rtps().data(5));
  EXPECT_EQ(flow().lost, 1U);  // 3
  arrive(Rtps().data(7).gap(6, 7, 0, 0));
  EXPECT_EQ(flow().lost, 1U);
}

TEST_F(OnTheWire, EndOfAnInstanceThatANewReaderMissedIsNoLoss) {
  arrive(Rtps().announce("rt/scan"));
  arrive(Rtps().announce_reader("rt/scan"));
  arrive(Rtps().data(1).heartbeat(1, 2));
  arrive(Rtps().announce_reader("rt/scan", 2));
  arrive(Rtps().key(2).data(3));
  EXPECT_EQ(flow().lost, 0U);
}

TEST_F(OnTheWire, EndOfAnInstanceIsNoMessageAndNoLoss) {
  arrive(Rtps().data(1));
  arrive(Rtps().key(2));
  arrive(Rtps().data(3));
  EXPECT_EQ(flow().messages, 2U);
  EXPECT_EQ(flow().lost, 0U);
}

TEST_F(OnTheWire, HeartbeatTellsOfMessagesThatNeverCame) {
  arrive(Rtps().data(1).heartbeat(1, 1));
  EXPECT_EQ(flow().lost, 0U);
  arrive(Rtps().heartbeat(1, 3));
  EXPECT_EQ(flow().lost, 2U);
  arrive(Rtps().data(2));
  EXPECT_EQ(flow().lost, 1U);
  EXPECT_EQ(flow().reordered, 0U);  // no later message came before it
}

TEST_F(OnTheWire, FragmentsMakeOneMessage) {
  arrive(Rtps().data(1));
  arrive(Rtps().fragment(2, 1, 1, 3));
  arrive(Rtps().fragment(2, 3, 1, 3));
  arrive(Rtps().fragment(2, 3, 1, 3));
  EXPECT_EQ(flow().messages, 1U);
  arrive(Rtps().fragment(2, 2, 1, 3));
  EXPECT_EQ(flow().messages, 2U);
  EXPECT_EQ(flow().lost, 0U);
  EXPECT_EQ(flow().reader.name, "10.0.0.2:7411");
  arrive(Rtps().fragment(2, 2, 1, 3), "10.0.0.3:7411");
  EXPECT_EQ(flow().reader.name, "10.0.0.2:7411 and 1 more");
}

TEST_F(OnTheWire, MessageOfWhichAFragmentIsMissingIsLost) {
  arrive(Rtps().data(1));
  arrive(Rtps().fragment(2, 1, 2, 3));
  arrive(Rtps().data(3));
  EXPECT_EQ(flow().lost, 1U);
}

TEST_F(OnTheWire, AnnouncedMessageWhoseFragmentsAreUnderWayIsNotLost) {
  arrive(Rtps().data(1));
  arrive(Rtps().fragment(2, 1, 1, 3).heartbeat(1, 2));
  EXPECT_EQ(flow().lost, 0U);
  arrive(Rtps().fragment(2, 2, 2, 3).heartbeat(1, 3));
  EXPECT_EQ(flow().lost, 1U);
}

TEST_F(OnTheWire, LastMessagesThatLackAFragmentAreLost) {
  arrive(Rtps().data(1));
  for (unsigned number = 2; number <= 5; ++number) arrive(Rtps().fragment(number, 1, 1, 2));
  EXPECT_EQ(flow().lost, 3U);  // 5 may be under way
}

TEST_F(OnTheWire, WriterWithoutACompleteMessageIsToldOf) {
  arrive(Rtps().fragment(1, 1, 1, 2));
  EXPECT_THAT(wire.findings().remarks, ::testing::IsEmpty());  // it may be under way
  arrive(Rtps().fragment(2, 1, 1, 2));
  EXPECT_THAT(wire.findings().flows, ::testing::IsEmpty());
  EXPECT_THAT(wire.findings().remarks, ::testing::ElementsAre(::testing::HasSubstr("fragments")));
}

TEST_F(OnTheWire, WriterIsNotToldOfForAMessageThatBeganBeforeTheCapture) {
  arrive(Rtps().fragment(1, 2, 1, 3).fragment(2, 1, 1, 3));
  EXPECT_THAT(wire.findings().remarks, ::testing::IsEmpty());
  arrive(Rtps().fragment(3, 1, 1, 3));
  EXPECT_THAT(wire.findings().remarks, ::testing::ElementsAre(::testing::HasSubstr("fragments")));
}

TEST_F(OnTheWire, SubmessageWithFewerBytesThanItsFragmentsIsIgnored) {
  arrive(Rtps().data(1));
  arrive(Rtps().fragment(2, 1, 3, 3, 2999));
  arrive(Rtps().data(3));
  EXPECT_EQ(flow().messages, 2U);
  EXPECT_EQ(flow().lost, 1U);
}

TEST_F(OnTheWire, FragmentsInADatagramCutShortAreThere) {
  arrive(Rtps().data(1));
  arrive_cut(Rtps().fragment(2, 1, 3, 3));
  EXPECT_EQ(flow().messages, 2U);
}

TEST_F(OnTheWire, FragmentsOfManyMessagesMayBeMixed) {
  for (unsigned fragment = 1; fragment <= 2; ++fragment)
    for (unsigned number = 1; number <= 60; ++number) arrive(Rtps().fragment(number, fragment, 1, 2));
  EXPECT_EQ(flow().messages, 60U);
  EXPECT_EQ(flow().lost, 0U);
}

TEST_F(OnTheWire, CompleteMessagesMakeRoomForPartialOnes) {
  arrive(Rtps().fragment(1, 1, 1, 2));
  for (unsigned number = 2; number <= 200; ++number) arrive(Rtps().fragment(number, 1, 2, 2));
  arrive(Rtps().fragment(1, 2, 1, 2));
  EXPECT_EQ(flow().messages, 199U);  // number 1 came before the first that was whole
  arrive(Rtps().fragment(300, 1, 1, 2));
  for (unsigned number = 301; number <= 500; ++number) arrive(Rtps().fragment(number, 1, 2, 2));
  arrive(Rtps().fragment(300, 2, 1, 2));
  EXPECT_EQ(flow().messages, 400U);
  EXPECT_EQ(flow().lost, 99U);  // 201 … 299
}

TEST_F(OnTheWire, AgeIsKnownOnOneHost) {
  // A quarter of a second before it is captured.
  const auto seconds = static_cast<std::uint32_t>((at_ns + 10'000'000) / 1'000'000'000);
  arrive(Rtps().stamp(seconds - 1, 0xc2900000).data(1), "10.0.0.1:7411", true);
  ASSERT_TRUE(flow().age);
  EXPECT_NEAR(static_cast<double>(flow().age->max_ns()), 250e6, 1e6);
}

TEST_F(OnTheWire, StampsLaterThanTheCaptureAreCounted) {
  arrive(Rtps().stamp(1000, 0).data(1), "10.0.0.1:7411", true);
  EXPECT_EQ(flow().stamp_ahead, 0U);
  const auto is_told = testing::Contains(testing::HasSubstr("clock is ahead"));
  EXPECT_THAT(wire.findings().remarks, testing::Not(is_told));
  for (unsigned number = 2; number <= 4; ++number)
    arrive(Rtps().stamp(1005, 0).data(number), "10.0.0.1:7411", true);
  EXPECT_EQ(flow().stamp_ahead, 3U);
  EXPECT_EQ(flow().age->count(), 4U);
  EXPECT_THAT(wire.findings().remarks, is_told);
  arrive(Rtps().stamp(1000, 0).data(5));
  EXPECT_EQ(flow().stamp_ahead, 3U);
}

TEST_F(OnTheWire, MessagesWithoutAStampAmongStampedOnesAreCounted) {
  for (unsigned number = 1; number <= 3; ++number)
    arrive(number == 2 ? Rtps().data(number) : Rtps().stamp(1000, 0).data(number), "10.0.0.1:7411", true);
  EXPECT_EQ(flow().age->count(), 2U);
  EXPECT_EQ(flow().age_unknown, 1U);
}

TEST_F(OnTheWire, StampOfAnotherClockGivesNoAge) {
  at_ns = 1'700'000'000'000'000'000;
  for (unsigned i = 1; i <= 5; ++i) arrive(Rtps().stamp(0, 0).data(i), "10.0.0.1:7411", true);
  for (unsigned i = 6; i <= 9; ++i) arrive(Rtps().stamp(1000 + i, 0).data(i), "10.0.0.1:7411", true);
  EXPECT_FALSE(flow().age);
  EXPECT_EQ(flow().age_unknown, 9U);
  EXPECT_EQ(flow().period.count(), 8U);
}

TEST_F(OnTheWire, LateRowIsMarkedIfItsMessageHadALossRow) {
  std::vector<std::pair<std::uint64_t, bool>> back;  // index, was_lost
  std::uint64_t lost = 0;
  wire.keep_rows([&](const Row& row) {
    if (row.quantity != Row::Quantity::age) return;
    lost += row.to_ns == 0 ? 1 : 0;
    if (row.index == 9 || row.index == 19) back.emplace_back(row.index, row.was_lost);
  });
  const auto seen = [&](unsigned number) {
    arrive(Rtps().stamp(1000, 0).data(number), "127.0.0.1:7411", true);
  };
  for (unsigned number = 1; number <= 3000; ++number) {
    if (number != 10 && number != 20) seen(number);
    if (number == 12) seen(10);
  }
  EXPECT_EQ(lost, 1U);
  seen(20);
  EXPECT_THAT(back, testing::ElementsAre(std::pair(9U, false), std::pair(19U, false), std::pair(19U, true)));
}

struct LossRows : OnTheWire {
  LossRows() {
    wire.keep_rows([this](const Row& row) {
      if (row.quantity == Row::Quantity::age && row.to_ns == 0) lost.emplace_back(row.index, row.from_ns);
    });
  }
  // The message of this number, which its writer published after so many seconds.
  void seen(unsigned number, unsigned at_s) {
    arrive(Rtps().stamp(1000 + at_s, 0).data(number), "127.0.0.1:7411", true);
  }
  static std::int64_t after(double seconds) { return static_cast<std::int64_t>((1000 + seconds) * 1e9); }
  std::vector<std::pair<std::uint64_t, std::int64_t>> lost;  // index, and when it was published
};

TEST_F(LossRows, LostMessageHasTheTimeBetweenItsNeighbours) {
  for (unsigned number = 1; number <= 200; ++number)
    if (number != 50 && number != 60 && number != 61) seen(number, number / 10);
  // From 49 to 51 its writer took 1 s, from 59 to 62 as well.
  EXPECT_THAT(lost, testing::ElementsAre(std::pair(49U, after(4.5)), std::pair(59U, after(5) + 333'333'333),
                                         std::pair(60U, after(5) + 666'666'666)));
}

TEST_F(LossRows, LossIsDecidedAfterTenSecondsAtTheLatest) {
  for (unsigned number = 1; number <= 20; ++number)
    if (number != 5) seen(number, number);
  EXPECT_THAT(lost, testing::ElementsAre(std::pair(4U, after(5))));
}

TEST_F(LossRows, EndOfTheSourceDecidesEachLossOnce) {
  for (unsigned number = 1; number <= 100; ++number)
    if (number != 97) seen(number, 2);
  arrive(Rtps().heartbeat(1, 101), "127.0.0.1:7411", true);
  arrive(Rtps().stamp(1003, 0).fragment(102, 1, 1, 2).heartbeat(1, 102), "127.0.0.1:7411", true);
  EXPECT_TRUE(lost.empty());
  wire.end();
  wire.end();
  EXPECT_EQ(lost.size(), 2U);
  EXPECT_EQ(flow().lost, 2U);
}

TEST_F(LossRows, LossesBeforeDropsOfTheCaptureHaveRows) {
  for (unsigned number = 1; number <= 20; ++number)
    if (number != 18) seen(number, 2);
  wire.interrupt();
  seen(40, 3);
  EXPECT_THAT(lost, testing::ElementsAre(std::pair(17U, after(2))));
  EXPECT_EQ(flow().lost, 1U);
}

TEST_F(OnTheWire, CopyOnAnotherInterfaceIsNoDuplicate) {
  const auto rtps = Rtps().data(1);
  for (const std::uint32_t interface : {2U, 3U, 3U})
    wire.add(++at_ns, {.source = "10.0.0.1:4000",
                       .destination = "10.0.0.2:7411",
                       .interface = interface,
                       .payload = rtps.bytes});
  EXPECT_EQ(flow().messages, 1U);
  EXPECT_EQ(flow().duplicated, 1U);
  EXPECT_EQ(flow().reader.name, "10.0.0.2:7411");
}

TEST_F(OnTheWire, WritersAreBounded) {
  auto rtps = Rtps().data(1);
  for (unsigned i = 0; i < Wire::most_writers + 100; ++i) {
    std::memcpy(rtps.bytes.data() + 8, &i, sizeof i);
    arrive(rtps);
  }
  std::set<std::uint64_t> ids;
  for (const auto& flow : wire.findings().flows) ids.insert(flow.id);
  EXPECT_EQ(ids.size(), Wire::most_writers);
  EXPECT_THAT(wire.findings().remarks, testing::Contains(testing::HasSubstr("100 messages")));
}

TEST_F(OnTheWire, BuiltInWritersAreNoTopics) {
  arrive(Rtps().data(1, {}, {0, 1, 0, 0xc2}));
  EXPECT_TRUE(wire.findings().flows.empty());
}

struct JudgedOnTheWire : OnTheWire {
  JudgedOnTheWire() : OnTheWire(Limits{.deadline = 15ms, .period = {}, .age = {}}) {}
};

TEST_F(JudgedOnTheWire, GapIsLate) {
  arrive(Rtps().data(1));
  at_ns += 10'000'000;
  arrive(Rtps().data(2));
  EXPECT_EQ(flow().late, 1U);
  const auto misses = wire.take_misses();
  ASSERT_EQ(misses.size(), 1U);
  EXPECT_EQ(misses[0].value_ns, 20'000'000);
}

}  // namespace
}  // namespace ontime::listen

// SPDX-License-Identifier: Apache-2.0
// What breaks the order of a writer's numbers: drops of the capture, a restart, a new reader, a datagram that
// is cut short.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "listen_on_the_wire.hpp"

namespace ontime::listen {
namespace {

TEST_F(OnTheWire, NothingIsLostAcrossDropsOfTheCapture) {
  arrive(Rtps().data(1));
  wire.interrupt();
  arrive(Rtps().data(50));
  arrive(Rtps().data(52));
  EXPECT_EQ(flow().lost, 1U);
  EXPECT_EQ(flow().period.count(), 1U);
}

TEST_F(OnTheWire, AnnouncedMessageIsNotLostIfTheCaptureDropsPackets) {
  arrive(Rtps().data(1));
  arrive(Rtps().data(3));
  arrive(Rtps().heartbeat(1, 4));
  wire.interrupt();
  arrive(Rtps().data(4));
  arrive(Rtps().data(5));
  EXPECT_EQ(flow().lost, 1U);  // 2
}

TEST_F(OnTheWire, AnnouncedMessageIsNotLostIfTheCaptureDropsPacketsAtItsEnd) {
  arrive(Rtps().data(1));
  arrive(Rtps().data(3));
  arrive(Rtps().heartbeat(1, 4));
  wire.interrupt();
  wire.end();
  EXPECT_EQ(flow().lost, 1U);  // 2
}

TEST_F(OnTheWire, AnnouncedMessagesOfAWriterThatRestartsAreLost) {
  arrive(Rtps().stamp(1, 0).data(1));
  arrive(Rtps().heartbeat(1, 4));
  arrive(Rtps().stamp(3, 0).data(1));
  EXPECT_EQ(flow().messages, 2U);
  EXPECT_EQ(flow().lost, 3U);
}

TEST_F(OnTheWire, NothingIsLostBeforeAGapOrAnEndAfterDropsOfTheCapture) {
  arrive(Rtps().data(1));
  wire.interrupt();
  arrive(Rtps().key(50).data(51));
  wire.interrupt();
  arrive(Rtps().gap(100, 101, 0, 0).data(101));
  EXPECT_EQ(flow().lost, 0U);
}

TEST_F(OnTheWire, WriterThatLeapsBeginsAnew) {
  arrive(Rtps().data(1));
  arrive(Rtps().data(std::uint64_t{1} << 40U));
  arrive(Rtps().heartbeat(1, std::uint64_t{1} << 60U));
  arrive(Rtps().gap(2, std::uint64_t{1} << 60U, 0, 0));
  EXPECT_EQ(flow().lost, 0U);
}

// A writer without a reader sends nothing, and numbers its messages.
TEST_F(OnTheWire, NumbersWithoutAReaderAreNotLost) {
  arrive(Rtps().announce("rt/scan"));
  arrive(Rtps().announce_reader("rt/scan"));
  arrive(Rtps().data(1));
  arrive(Rtps().announce_reader("rt/map", 1));
  arrive(Rtps().announce_reader("rt/scan"));  // again
  arrive(Rtps().data(3));
  EXPECT_EQ(flow().lost, 1U);  // they had their reader
  arrive(Rtps().announce_reader("rt/scan", 2));
  arrive(Rtps().data(100));
  EXPECT_EQ(flow().lost, 1U);
  arrive(Rtps().data(102));
  EXPECT_EQ(flow().lost, 2U);
  arrive(Rtps().announce_reader("rt/scan", 3));
  arrive(Rtps().data(102));  // repeated
  arrive(Rtps().heartbeat(1, 199));
  arrive(Rtps().gap(150, 200, 0, 0));
  arrive(Rtps().data(300).data(301));
  EXPECT_EQ(flow().lost, 2U);
  EXPECT_EQ(flow().messages, 6U);
}

// Passed over for another reader, or because it was announced before the new reader had it.
TEST_F(OnTheWire, MessageIsCountedAlthoughItsNumberWasPassedOver) {
  arrive(Rtps().announce("rt/scan"));
  arrive(Rtps().stamp(1, 0).data(1));
  arrive(Rtps().announce_reader("rt/scan"));
  arrive(Rtps().heartbeat(1, 3));
  for (unsigned i = 2; i <= 4; ++i) arrive(Rtps().stamp(i, 0).data(i));
  EXPECT_EQ(flow().messages, 4U);
  EXPECT_EQ(flow().reordered, 0U);
  arrive(Rtps().stamp(4, 0).data(4));
  EXPECT_EQ(flow().messages, 4U);
  EXPECT_EQ(flow().duplicated, 1U);
  arrive(Rtps().announce_reader("rt/scan", 2));
  arrive(Rtps().stamp(6, 0).data(6));
  arrive(Rtps().stamp(5, 0).data(5));
  EXPECT_EQ(flow().messages, 6U);
  EXPECT_EQ(flow().reordered, 1U);
  EXPECT_EQ(flow().lost, 0U);
}

TEST_F(OnTheWire, NewReaderIsSeenHoweverManyThereWere) {
  arrive(Rtps().announce("rt/scan"));
  for (unsigned i = 0; i <= Wire::most_names; ++i) arrive(Rtps().announce_reader("rt/map", i));
  arrive(Rtps().data(1));
  arrive(Rtps().announce_reader("rt/scan", Wire::most_names + 1));
  arrive(Rtps().data(100));
  EXPECT_EQ(flow().lost, 0U);
}

TEST_F(OnTheWire, MessageThatANewReaderHasInFragmentsIsCounted) {
  arrive(Rtps().announce("rt/scan"));
  arrive(Rtps().data(1));
  arrive(Rtps().announce_reader("rt/scan"));
  arrive(Rtps().fragment(50, 1, 1, 2));
  arrive(Rtps().data(51));
  EXPECT_EQ(flow().lost, 1U);
  arrive(Rtps().fragment(50, 2, 1, 2));
  EXPECT_EQ(flow().lost, 0U);
  EXPECT_EQ(flow().messages, 3U);
}

TEST_F(OnTheWire, WriterThatRestartsWithItsGuidIsCountedAgain) {
  unsigned second = 0;
  for (unsigned i = 1; i <= 5000; ++i) arrive(Rtps().stamp(++second, 0).data(i));
  for (unsigned i = 1; i <= 3; ++i) arrive(Rtps().stamp(++second, 0).data(i));
  for (unsigned i = 1; i <= 3; ++i)
    for (unsigned fragment = 1; fragment <= 2; ++fragment)
      arrive(Rtps().stamp(second + i, 0).fragment(i, fragment, 1, 2));
  EXPECT_EQ(flow().messages, 5006U);
  EXPECT_EQ(flow().period.count(), 5005U);
  EXPECT_EQ(flow().lost, 0U);
  EXPECT_EQ(flow().duplicated, 0U);
  EXPECT_EQ(flow().reordered, 0U);
  arrive(Rtps().stamp(second + 2, 0).data(2));
  EXPECT_EQ(flow().messages, 5006U);
  EXPECT_EQ(flow().duplicated, 1U);
}

// Its first messages find no reader yet. The numbers of the next were missing, or passed over, before.
TEST_F(OnTheWire, RestartIsSeenAmongNumbersThatNeverCame) {
  arrive(Rtps().announce("rt/scan"));
  arrive(Rtps().stamp(1, 0).data(1));
  arrive(Rtps().stamp(5, 0).data(5));
  arrive(Rtps().announce_reader("rt/scan"));
  arrive(Rtps().stamp(50, 0).data(50));
  EXPECT_EQ(flow().lost, 3U);
  for (unsigned i = 7; i <= 60; ++i) arrive(Rtps().stamp(60, i << 24U).data(i));
  EXPECT_EQ(flow().messages, 57U);
  for (unsigned i = 3; i <= 60; ++i) arrive(Rtps().stamp(70, i << 24U).data(i));
  EXPECT_EQ(flow().messages, 115U);
  EXPECT_EQ(flow().reordered, 0U);
  EXPECT_EQ(flow().duplicated, 0U);
  EXPECT_EQ(flow().lost, 3U);
}

TEST_F(OnTheWire, DatagramCutShortMakesNoLoss) {
  arrive(Rtps().data(1));
  arrive_cut(Rtps().data(2).data(3, Bytes(100)));
  arrive(Rtps().data(9));
  EXPECT_EQ(flow().lost, 0U);
  EXPECT_THAT(wire.findings().remarks, testing::Contains(testing::HasSubstr("in part")));
  EXPECT_THAT(wire.findings().incomplete, testing::ElementsAre(testing::HasSubstr("in part")));
}

// Any program can send one. No reader takes its last submessage.
TEST_F(OnTheWire, InvalidDatagramHidesNoLossAndIsNoMessage) {
  arrive(Rtps().data(1));
  auto invalid = Rtps().data(2).data(3, Bytes(100));
  invalid.bytes.resize(invalid.bytes.size() - 50);
  arrive(invalid);
  arrive(Rtps().data(9));
  EXPECT_EQ(flow().messages, 3U);
  EXPECT_EQ(flow().lost, 6U);
  EXPECT_EQ(flow().period.count(), 2U);
  EXPECT_THAT(wire.findings().remarks, testing::Not(testing::Contains(testing::HasSubstr("in part"))));
}

// To two readers, by a capture that keeps only the begin of each datagram.
TEST_F(OnTheWire, CopyOfAMessageInACutDatagramIsNoMessage) {
  for (unsigned i = 1; i <= 10; ++i)
    for (const auto* reader : {"10.0.0.2:7411", "10.0.0.3:7411"})
      arrive_cut(Rtps().stamp(i, 0).data(i, Bytes(100)), reader);
  EXPECT_EQ(flow().messages, 10U);
  EXPECT_EQ(flow().duplicated, 0U);
  EXPECT_EQ(flow().lost, 0U);
}

// What a reader did not have is sent again, when packets were dropped.
TEST_F(OnTheWire, RepeatedMessageAfterDropsOfTheCaptureMakesNoLoss) {
  for (unsigned i = 1; i <= 100; ++i) arrive(Rtps().stamp(i, 0).data(i));
  wire.interrupt();
  arrive(Rtps().stamp(50, 0).data(50));
  for (unsigned i = 103; i <= 110; ++i) arrive(Rtps().stamp(i, 0).data(i));
  arrive(Rtps().stamp(102, 0).data(102));
  EXPECT_EQ(flow().messages, 109U);
  EXPECT_EQ(flow().duplicated, 1U);
  EXPECT_EQ(flow().reordered, 1U);
  EXPECT_EQ(flow().lost, 0U);
}

TEST_F(OnTheWire, WriterThatRestartsAmongDropsOfTheCaptureIsCountedAgain) {
  for (unsigned i = 1; i <= 10; ++i) arrive(Rtps().stamp(i, 0).data(i));
  wire.interrupt();
  for (unsigned i = 3; i <= 12; ++i) arrive(Rtps().stamp(100 + i, 0).data(i));
  EXPECT_EQ(flow().messages, 20U);
  EXPECT_EQ(flow().lost, 0U);
}

}  // namespace
}  // namespace ontime::listen

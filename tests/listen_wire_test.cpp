// SPDX-License-Identifier: Apache-2.0
// Packets made by hand.
#include <cstring>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <pcap/dlt.h>

#include "listen/packets.hpp"
#include "listen/rtps.hpp"
#include "listen/wire.hpp"

namespace ontime::listen {
namespace {

using namespace std::chrono_literals;
using Bytes = std::vector<std::byte>;

void add(Bytes& bytes, std::initializer_list<unsigned> values) {
  for (const auto value : values) bytes.push_back(static_cast<std::byte>(value));
}
void add_little(Bytes& bytes, std::uint64_t value, std::size_t size) {
  for (std::size_t i = 0; i < size; ++i) bytes.push_back(static_cast<std::byte>(value >> (8 * i)));
}
void add_sequence(Bytes& bytes, std::uint64_t number) {
  add_little(bytes, number >> 32U, 4);
  add_little(bytes, number, 4);
}

constexpr std::array<unsigned, 4> user_writer{0, 0, 0x12, 0x03}, publications{0, 0, 0x03, 0xc2};

class Rtps {
 public:
  Rtps() { add(bytes, {'R', 'T', 'P', 'S', 2, 1, 1, 0x10, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12}); }
  Rtps& stamp(std::uint32_t seconds, std::uint32_t fraction) {
    Bytes body;
    add_little(body, seconds, 4);
    add_little(body, fraction, 4);
    return submessage(0x09, 1, body);
  }
  Rtps& data(std::uint64_t number, const Bytes& payload = {}, std::array<unsigned, 4> writer = user_writer) {
    Bytes body;
    add(body, {0, 0, 16, 0, 0, 0, 0, 0, writer[0], writer[1], writer[2], writer[3]});
    add_sequence(body, number);
    body.insert(body.end(), payload.begin(), payload.end());
    return submessage(0x15, 5, body);
  }
  Rtps& key(std::uint64_t number) {  // an instance ends
    Bytes body;
    add(body, {0, 0, 16, 0, 0, 0, 0, 0, 0, 0, 0x12, 0x03});
    add_sequence(body, number);
    return submessage(0x15, 9, body);
  }
  Rtps& fragment(std::uint64_t number, unsigned first, unsigned count, unsigned total) {
    Bytes body;
    add(body, {0, 0, 28, 0, 0, 0, 0, 0, 0, 0, 0x12, 0x03});
    add_sequence(body, number);
    add_little(body, first, 4);
    add_little(body, count, 2);
    add_little(body, 1000, 2);
    add_little(body, total * 1000, 4);
    return submessage(0x16, 1, body);
  }
  Rtps& gap(std::uint64_t first, std::uint64_t base, unsigned bits, std::uint32_t word) {
    Bytes body;
    add(body, {0, 0, 0, 0, 0, 0, 0x12, 0x03});
    add_sequence(body, first);
    add_sequence(body, base);
    add_little(body, bits, 4);
    if (bits > 0) add_little(body, word, 4);
    return submessage(0x08, 1, body);
  }
  Rtps& heartbeat(std::uint64_t first, std::uint64_t last) {
    Bytes body;
    add(body, {0, 0, 0, 0, 0, 0, 0x12, 0x03});
    add_sequence(body, first);
    add_sequence(body, last);
    add_little(body, 1, 4);
    return submessage(0x07, 1, body);
  }
  // Discovery of the user's writer.
  Rtps& announce(const std::string& topic) {
    Bytes list;
    add(list, {0, 3, 0, 0});
    add_little(list, 0x5a, 2);
    add_little(list, 16, 2);
    add(list, {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 0, 0, 0x12, 0x03});
    const auto size = topic.size() + 1, padded = (size + 3) / 4 * 4;
    add_little(list, 5, 2);
    add_little(list, 4 + padded, 2);
    add_little(list, size, 4);
    for (std::size_t i = 0; i < padded; ++i)
      list.push_back(static_cast<std::byte>(i < topic.size() ? topic[i] : 0));
    add(list, {1, 0, 0, 0});
    return data(1, list, publications);
  }
  Rtps& submessage(unsigned kind, unsigned flags, const Bytes& body) {
    add(bytes, {kind, flags});
    add_little(bytes, body.size(), 2);
    bytes.insert(bytes.end(), body.begin(), body.end());
    return *this;
  }
  Bytes bytes;
};

class OnTheWire : public testing::Test {
 protected:
  OnTheWire() : OnTheWire(Limits{}) {}
  explicit OnTheWire(const Limits& limits) : wire(limits) {}
  void arrive(const Rtps& rtps, const std::string& destination = "10.0.0.2:7411", bool is_one_host = false) {
    at_ns += 10'000'000;
    wire.add(at_ns, {.source = "10.0.0.1:4000",
                     .destination = destination,
                     .is_one_host = is_one_host,
                     .payload = rtps.bytes});
  }
  Flow flow() const { return wire.findings().flows.at(0); }
  Wire wire;
  std::int64_t at_ns = 1'000'000'000'000;
};

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
}

TEST_F(OnTheWire, MessageOfWhichAFragmentIsMissingIsLost) {
  arrive(Rtps().data(1));
  arrive(Rtps().fragment(2, 1, 2, 3));
  arrive(Rtps().data(3));
  EXPECT_EQ(flow().lost, 1U);
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

TEST_F(OnTheWire, NothingIsLostAcrossDropsOfTheCapture) {
  arrive(Rtps().data(1));
  wire.interrupt();
  arrive(Rtps().data(50));
  arrive(Rtps().data(52));
  EXPECT_EQ(flow().lost, 1U);
  EXPECT_EQ(flow().period.count(), 1U);
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

TEST_F(OnTheWire, DatagramCutShortMakesNoLoss) {
  arrive(Rtps().data(1));
  auto cut = Rtps().data(2).data(3, Bytes(100));
  cut.bytes.resize(cut.bytes.size() - 50);
  arrive(cut);
  arrive(Rtps().data(9));
  EXPECT_EQ(flow().lost, 0U);
  EXPECT_THAT(wire.findings().remarks, testing::Contains(testing::HasSubstr("in part")));
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

TEST(RtpsDatagram, DatagramOfAnyLengthIsReadWithinItsBounds) {
  const auto whole = Rtps()
                         .stamp(1, 2)
                         .data(7, Bytes(8))
                         .gap(8, 10, 32, 5)
                         .heartbeat(1, 9)
                         .fragment(11, 1, 1, 2)
                         .announce("x")
                         .bytes;
  for (std::size_t size = 0; size <= whole.size(); ++size) {
    const std::vector<std::byte> part(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size));
    const auto outcome = rtps::visit(part, {});
    EXPECT_EQ(outcome == rtps::Outcome::foreign, size < 20) << size;
  }
  EXPECT_EQ(rtps::visit(whole, {}), rtps::Outcome::whole);
}

TEST(RtpsDatagram, InfoSourceNamesAnotherParticipant) {
  Bytes body(8);
  add(body, {9, 9, 9, 9, 9, 9, 9, 9, 9, 9, 9, 9});
  std::string writer;
  rtps::visit(Rtps().submessage(0x0c, 1, body).data(1).bytes,
              {.data = [&](const rtps::Data& data) { writer = rtps::text_of(data.writer); },
               .gap = {},
               .heartbeat = {}});
  EXPECT_EQ(writer, "09090909.09090909.09090909:00001203");
}

// An IPv4 packet with UDP in Ethernet.
Bytes frame_of(const Bytes& udp_payload, std::size_t from, std::size_t bytes, bool more, unsigned id = 7) {
  Bytes udp;
  add(udp, {0x1c, 0xe8, 0x1c, 0xf3});
  add(udp, {static_cast<unsigned>((udp_payload.size() + 8) >> 8U),
            static_cast<unsigned>(udp_payload.size() + 8) & 0xff, 0, 0});
  udp.insert(udp.end(), udp_payload.begin(), udp_payload.end());
  bytes = std::min(bytes, udp.size() - from);
  Bytes frame(12);
  add(frame, {0x08, 0x00, 0x45, 0, static_cast<unsigned>((bytes + 20) >> 8U),
              static_cast<unsigned>(bytes + 20) & 0xff, 0, id});
  const auto flags = static_cast<unsigned>(from / 8) | (more ? 0x2000U : 0U);
  add(frame, {flags >> 8U, flags & 0xff, 64, 17, 0, 0, 10, 0, 0, 1, 10, 0, 0, 2});
  frame.insert(frame.end(), udp.begin() + static_cast<std::ptrdiff_t>(from),
               udp.begin() + static_cast<std::ptrdiff_t>(from + bytes));
  return frame;
}

TEST(Frames, DatagramHasItsAddresses) {
  Packets packets(DLT_EN10MB);
  const auto payload = Rtps().data(1).bytes;
  const auto frame = frame_of(payload, 0, 1500, false);
  const auto found = packets.datagram(frame);  // its payload is the frame's
  ASSERT_TRUE(found);
  EXPECT_EQ(found->source, "10.0.0.1:7400");
  EXPECT_EQ(found->destination, "10.0.0.2:7411");
  EXPECT_FALSE(found->is_one_host);
  EXPECT_TRUE(std::equal(payload.begin(), payload.end(), found->payload.begin(), found->payload.end()));
}

TEST(Frames, FragmentsInAnyOrderMakeOneDatagram) {
  Packets packets(DLT_EN10MB);
  Bytes payload(3000);
  for (std::size_t i = 0; i < payload.size(); ++i) payload[i] = static_cast<std::byte>(i * 31);
  EXPECT_FALSE(packets.datagram(frame_of(payload, 1480, 1480, true)));
  EXPECT_FALSE(packets.datagram(frame_of(payload, 2960, 1480, false)));
  const auto found = packets.datagram(frame_of(payload, 0, 1480, true));
  ASSERT_TRUE(found);
  EXPECT_TRUE(std::equal(payload.begin(), payload.end(), found->payload.begin(), found->payload.end()));
}

TEST(Frames, FragmentSeenTwiceCountsOnce) {
  Packets packets(DLT_EN10MB);
  const Bytes payload(3000, std::byte{5});
  EXPECT_FALSE(packets.datagram(frame_of(payload, 0, 1480, true)));
  EXPECT_FALSE(packets.datagram(frame_of(payload, 0, 1480, true)));
  EXPECT_FALSE(packets.datagram(frame_of(payload, 2960, 1480, false)));
  EXPECT_FALSE(packets.datagram(frame_of(payload, 2960, 1480, false)));
  const auto found = packets.datagram(frame_of(payload, 1480, 1480, true));
  ASSERT_TRUE(found);
  EXPECT_TRUE(std::equal(payload.begin(), payload.end(), found->payload.begin(), found->payload.end()));
}

// Of IPv6: a fragment of a UDP datagram with this payload.
Bytes frame6_of(const Bytes& udp_payload, std::size_t from, std::size_t bytes, bool more) {
  const auto ipv4 = frame_of(udp_payload, from, bytes, more);
  const Bytes piece(ipv4.begin() + 34, ipv4.end());
  const auto size = static_cast<unsigned>(piece.size() + 8),
             at = static_cast<unsigned>(from) | (more ? 1U : 0U);
  Bytes frame(12);
  add(frame, {0x86, 0xdd, 0x60, 0, 0, 0, size >> 8U, size & 0xff, 44, 64});
  frame.resize(frame.size() + 32);
  add(frame, {17, 0, at >> 8U, at & 0xff, 0, 0, 0, 9});
  frame.insert(frame.end(), piece.begin(), piece.end());
  add(frame, {1, 2, 3, 4});  // padding of Ethernet
  return frame;
}

TEST(Frames, FragmentsOfIpv6MakeOneDatagram) {
  Packets packets(DLT_EN10MB);
  Bytes payload(3000);
  for (std::size_t i = 0; i < payload.size(); ++i) payload[i] = static_cast<std::byte>(i * 31);
  EXPECT_FALSE(packets.datagram(frame6_of(payload, 0, 1448, true)));
  EXPECT_FALSE(packets.datagram(frame6_of(payload, 2896, 1448, false)));
  const auto found = packets.datagram(frame6_of(payload, 1448, 1448, true));
  ASSERT_TRUE(found);
  EXPECT_EQ(found->destination, "[::]:7411");
  EXPECT_TRUE(std::equal(payload.begin(), payload.end(), found->payload.begin(), found->payload.end()));
  for (std::size_t size = 0; size < 70; ++size) {
    const auto whole = frame6_of(payload, 0, 1448, true);
    packets.datagram(std::span(whole).first(size));
  }
}

TEST(Frames, DatagramCutByTheCaptureIsMarked) {
  auto payload = Rtps().data(1).bytes;
  payload.resize(3000);
  const auto cut = [](const Bytes& frame, std::size_t size) {
    Packets packets(DLT_EN10MB);
    const auto found = packets.datagram(std::span(frame).first(size));
    return found && found->is_cut;
  };
  const auto frame = frame_of(payload, 0, 4000, false);
  EXPECT_FALSE(cut(frame, frame.size()));
  for (const std::size_t size : {42U, 44U, 60U, 1000U}) EXPECT_TRUE(cut(frame, size)) << size;
  EXPECT_TRUE(cut(frame_of(payload, 0, 1480, true), 1000));
  EXPECT_TRUE(cut(frame6_of(payload, 0, 1448, true), 1000));
  EXPECT_FALSE(cut(frame_of(Bytes(3000), 0, 4000, false), 1000)) << "it is no RTPS";
}

TEST(Frames, InterfaceIsThatOfTheCookedHeader) {
  const auto frame = frame_of(Rtps().data(1).bytes, 0, 1500, false);
  Bytes cooked;
  add(cooked, {0x08, 0x00, 0, 0, 0, 0, 0, 7, 0, 1, 0, 6, 0, 0, 0, 0, 0, 0, 0, 0});
  cooked.insert(cooked.end(), frame.begin() + 14, frame.end());
  Packets packets(DLT_LINUX_SLL2);
  const auto found = packets.datagram(cooked);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->interface, 7U);
}

TEST(Frames, FragmentsThatNeverEndAreForgotten) {
  Packets packets(DLT_EN10MB);
  const Bytes payload(3000);
  EXPECT_FALSE(packets.datagram(frame_of(payload, 0, 1480, true, 0)));
  for (unsigned id = 1; id < 200; ++id) EXPECT_FALSE(packets.datagram(frame_of(payload, 0, 1480, true, id)));
  EXPECT_FALSE(packets.datagram(frame_of(payload, 1480, 2000, false, 0)));
}

TEST(Frames, FrameOfAnyLengthIsReadWithinItsBounds) {
  const auto whole = frame_of(Rtps().data(1).bytes, 0, 1500, false);
  for (const int type : {DLT_EN10MB, DLT_LINUX_SLL, DLT_LINUX_SLL2, DLT_RAW})
    for (std::size_t size = 0; size <= whole.size(); ++size) {
      Packets packets(type);
      const std::vector<std::byte> part(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size));
      packets.datagram(part);
    }
}

TEST(Frames, SendingHalfOnLoopbackIsLeftOut) {
  auto frame = frame_of(Rtps().data(1).bytes, 0, 1500, false);
  const auto cooked = [&](unsigned direction) {
    Bytes bytes;
    add(bytes, {0, direction, 0x03, 0x04, 0, 6, 0, 0, 0, 0, 0, 0, 0, 0, 0x08, 0x00});
    bytes.insert(bytes.end(), frame.begin() + 14, frame.end());
    return bytes;
  };
  Packets packets(DLT_LINUX_SLL);
  EXPECT_TRUE(packets.datagram(cooked(0)));
  EXPECT_FALSE(packets.datagram(cooked(4)));
}

TEST(Frames, UnknownLinkTypeIsRefused) { EXPECT_THROW(Packets(DLT_IEEE802_11), Error); }

}  // namespace
}  // namespace ontime::listen

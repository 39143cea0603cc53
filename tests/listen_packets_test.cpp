// SPDX-License-Identifier: Apache-2.0
// Frames and datagrams of any length and form.
#include <chrono>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <pcap/dlt.h>

#include "listen/clock_steps.hpp"
#include "listen/listen.hpp"
#include "listen/packets.hpp"
#include "listen_rtps.hpp"

namespace ontime::listen {
namespace {

TEST(RtpsDatagram, DatagramOfAnyLengthIsReadWithinItsBounds) {
  int seen = 0;
  rtps::Visitor visitor;
  visitor.data = [&](const rtps::Data&) { ++seen; };
  visitor.heartbeat = [&](const rtps::Heartbeat&) { ++seen; };
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
    for (const bool is_cut : {false, true}) {
      seen = 0;
      rtps::visit(part, visitor, is_cut);
      EXPECT_TRUE(size >= 20 || seen == 0) << "no RTPS: " << size;
    }
  }
  EXPECT_EQ(seen, 4) << "the message, its fragment, the announcement and the heartbeat";
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

TEST(Frames, DatagramOfAVlanIsRead) {
  const auto frame = frame_of(Rtps().data(1).bytes, 0, 1500, false);
  Bytes one_tag, two_tags;
  add(one_tag, {0x81, 0x00, 0, 5});
  add(two_tags, {0x88, 0xa8, 0, 7, 0x81, 0x00, 0, 5});
  for (const auto& tags : {one_tag, two_tags}) {
    auto tagged = frame;
    tagged.insert(tagged.begin() + 12, tags.begin(), tags.end());
    const auto found = Packets(DLT_EN10MB).datagram(tagged);
    ASSERT_TRUE(found) << tags.size();
    EXPECT_EQ(found->destination, "10.0.0.2:7411");
  }
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

TEST(Frames, DatagramOfAPacketThatIsShorterThanItStatesIsCut) {
  const auto stated = [](Bytes frame, std::size_t at, std::byte high) {
    frame[at] = high;
    Packets packets(DLT_EN10MB);
    const auto found = packets.datagram(frame);
    return found && found->is_cut;
  };
  const auto ipv4 = frame_of(Rtps().data(1).bytes, 0, 4000, false);
  auto ipv6 = frame6_of(Rtps().data(1).bytes, 0, 4000, false);
  ipv6.erase(ipv6.begin() + 54, ipv6.begin() + 62);  // without the header of a fragment
  ipv6[20] = std::byte{17};
  ipv6[19] = static_cast<std::byte>(std::to_integer<unsigned>(ipv6[19]) - 8);
  for (const auto& [frame, at] : {std::pair(ipv4, 16), std::pair(ipv6, 18)}) {
    EXPECT_FALSE(stated(frame, at, frame[at]));
    EXPECT_TRUE(stated(frame, at, std::byte{2}));
  }
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

TEST(Frames, FragmentsOfAnEarlierDatagramWithTheSameIdentificationAreForgotten) {
  constexpr std::int64_t second_ns = 1'000'000'000;
  Packets packets(DLT_EN10MB);
  const Bytes earlier(3000, std::byte{1}), payload(5000, std::byte{5});
  EXPECT_FALSE(packets.datagram(frame_of(earlier, 0, 1480, true)));
  EXPECT_FALSE(packets.datagram(frame_of(earlier, 2960, 1480, false)));
  std::optional<Datagram> found;
  for (std::size_t from = 0; from < 5008; from += 1480) {
    EXPECT_FALSE(found);
    found = packets.datagram(frame_of(payload, from, 1480, from < 4440), 70 * second_ns);
  }
  ASSERT_TRUE(found);
  EXPECT_TRUE(std::equal(payload.begin(), payload.end(), found->payload.begin(), found->payload.end()));
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

constexpr std::array<unsigned, 4> other_writer{0, 0, 0x13, 0x03};

// A file of libpcap with times in nanoseconds, in which a message was captured at each of these; from
// `other_from` on, of another writer.
std::string capture_of(const std::vector<std::int64_t>& times_ns, std::size_t other_from = SIZE_MAX) {
  Bytes file;
  add_little(file, 0xa1b23c4d, 4);
  add(file, {2, 0, 4, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xff, 0xff, 0, 0, DLT_EN10MB, 0, 0, 0});
  for (std::size_t i = 0; i < times_ns.size(); ++i) {
    const auto frame =
        frame_of(Rtps().data(i + 1, {}, i < other_from ? user_writer : other_writer).bytes, 0, 1500, false);
    add_little(file, static_cast<std::uint64_t>(times_ns[i]) / 1'000'000'000, 4);
    add_little(file, static_cast<std::uint64_t>(times_ns[i]) % 1'000'000'000, 4);
    for (int length = 0; length < 2; ++length) add_little(file, frame.size(), 4);
    file.insert(file.end(), frame.begin(), frame.end());
  }
  auto path = testing::TempDir() + "ontime-capture.pcap";
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(file.data()), static_cast<std::streamsize>(file.size()));
  return path;
}

TEST(CaptureFile, NoPeriodGoesAcrossAStepBackOfItsClock) {
  constexpr std::int64_t begin_ns = 1'700'000'000'000'000'000, period_ns = 10'000'000,
                         hour_ns = 3'600'000'000'000;
  std::vector<std::int64_t> times_ns;
  for (int i = 0; i < 20; ++i) times_ns.push_back(begin_ns + i * period_ns - (i < 10 ? 0 : hour_ns));
  std::swap(times_ns[3], times_ns[4]);  // of two interfaces
  const auto path = capture_of(times_ns);
  const auto sensor = in_pcap_file(path, {});
  while (sensor->listen_for(std::chrono::milliseconds(1))) continue;
  const auto findings = sensor->findings();
  std::filesystem::remove(path);
  ASSERT_EQ(findings.flows.size(), 1U);
  EXPECT_EQ(findings.flows[0].messages, 20U);
  EXPECT_EQ(findings.flows[0].period.count(), 18U);
  EXPECT_THAT(findings.remarks, testing::Contains(testing::HasSubstr("once, 3600.0 s back. Periods")));
}

// As a node that hangs when the clock is set.
TEST(CaptureFile, WriterThatStopsWhereTheClockIsSetBackIsSilent) {
  constexpr std::int64_t begin_ns = 1'700'000'000'000'000'000, period_ns = 10'000'000;
  for (const std::int64_t back_ns : {3'600'000'000'000L, 2'000'000'000L, 0L}) {
    std::vector<std::int64_t> times_ns;
    for (int i = 0; i < 500; ++i) times_ns.push_back(begin_ns + i * period_ns - (i < 100 ? 0 : back_ns));
    const auto path = capture_of(times_ns, 100);
    const auto sensor =
        in_pcap_file(path, {.deadline = std::chrono::milliseconds(500), .period = {}, .age = {}});
    while (sensor->listen_for(std::chrono::milliseconds(1))) continue;
    const auto flows = sensor->findings().flows;
    std::filesystem::remove(path);
    ASSERT_EQ(flows.size(), 2U);
    EXPECT_NEAR(static_cast<double>(flows[0].silent_ns), 4e9, 0.02e9) << back_ns;
    EXPECT_EQ(flows[1].silent_ns, 0) << back_ns;
  }
}

TEST(ClockSteps, StepIsToldFromSlewing) {
  constexpr std::int64_t second_ns = 1'000'000'000;
  ClockSteps clock;
  EXPECT_EQ(clock.look(5 * second_ns, second_ns), 0);
  EXPECT_EQ(clock.look(5 * second_ns + 9'000'000, 11 * second_ns), 0) << "0.9 ms in each second";
  EXPECT_EQ(clock.look(8 * second_ns + 9'000'000, 12 * second_ns), 3 * second_ns);
  EXPECT_EQ(clock.look(8 * second_ns + 9'000'000, 13 * second_ns), 0);
  int exact = 0;
  const auto exactly = [&] { return 8 * second_ns + ++exact; };
  EXPECT_EQ(clock.look(8 * second_ns + 9'500'000, 13 * second_ns + 5, exactly), 0);
  EXPECT_EQ(exact, 0);
  EXPECT_EQ(clock.look(8 * second_ns, 13 * second_ns + 10, exactly), -8'999'999);
  EXPECT_EQ(clock.look(8 * second_ns, 15 * second_ns, exactly), 0);
  EXPECT_EQ(exact, 2) << "each second, so that slewing adds up to no step";
}

}  // namespace
}  // namespace ontime::listen

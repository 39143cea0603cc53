// SPDX-License-Identifier: Apache-2.0
// The cases of measuring_path_test.cpp, and what is allowed in each.
#pragma once

#include <array>
#include <optional>
#include <ostream>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "roundtrip/roundtrip.hpp"
#include "transport/transport.hpp"

namespace ontime::roundtrip {
namespace {

struct Case {
  const char* transport;
  Schedule schedule;
  transport::Receive receive;
  transport::Reliability reliability = transport::Reliability::best_effort;
  std::size_t payload_bytes = 500;
  std::optional<Where> background = {};
  std::int64_t launch_ns = 0;
};
void PrintTo(const Case& value, std::ostream* out) {
  *out << value.transport << ' ' << word_of(value.schedule);
}

std::vector<Case> cases() {
  using transport::Receive, transport::Reliability;
  constexpr std::size_t small = 500, most_of_a_frame = 1468, most_of_udp = 65'475,
                        beyond_a_datagram = 64 << 10;
  const std::array<std::pair<Schedule, Receive>, 3> dds{{{Schedule::next_free, Receive::listener},
                                                         {Schedule::fixed, Receive::waitset},
                                                         {Schedule::back_to_back, Receive::listener}}};
  std::vector<Case> result;
  for (const auto bytes : {small, most_of_udp}) {
    for (const auto& [schedule, receive] : dds)
      result.push_back({"udp", schedule, receive, Reliability::best_effort, bytes});
    result.push_back({"udp", Schedule::back_to_back, Receive::waitset, Reliability::best_effort, bytes});
  }
  for (const auto* transport : {"ethernet", "xdp"})
    for (const auto bytes : {small, most_of_a_frame}) {
      for (const auto& [schedule, receive] : dds)
        result.push_back({transport, schedule, receive, Reliability::best_effort, bytes});
    }
  for (const auto* transport : {"udp", "ethernet"})
    result.push_back(
        {transport, Schedule::fixed, Receive::listener, Reliability::best_effort, small, {}, 100'000});
  for (const auto* transport : {"cyclonedds", "fastdds", "opendds"})
    for (const auto reliability : {Reliability::best_effort, Reliability::reliable})
      for (const auto bytes : {small, beyond_a_datagram})
        for (const auto& [schedule, receive] : dds)
          result.push_back({transport, schedule, receive, reliability, bytes});
  for (const auto* transport : {"cyclonedds", "fastdds", "opendds"})
    for (const auto where : {Where::same_participant, Where::same_process})
      for (const auto& [schedule, receive] : dds)
        result.push_back({transport, schedule, receive, Reliability::best_effort, small, where});
  return result;
}

bool is_below_ip(const Case& value) {
  const std::string transport = value.transport;
  return transport == "ethernet" || transport == "xdp";
}

std::string name_of(const testing::TestParamInfo<Case>& info) {
  const auto& value = info.param;
  std::string name = std::string(value.transport) + "_" + word_of(value.schedule);
  std::erase(name, '-');
  name += value.receive == transport::Receive::listener ? "_listener" : "_waitset";
  name += value.reliability == transport::Reliability::reliable ? "_reliable_" : "_besteffort_";
  if (value.background) name += *value.background == Where::same_participant ? "shared_" : "beside_";
  if (value.launch_ns > 0) name += "launched_";
  return name + std::to_string(value.payload_bytes);
}

// What the middlewares themselves do, as this test and a debugger found it: of one thread, in so many
// messages.
std::uint64_t allocations_allowed(const Case& value, std::uint64_t messages) {
  const std::string transport = value.transport;
  // Cyclone DDS 0.10 receives into blocks of 1 MiB and takes the next when one is full, and at times finds
  // its list of free messages empty: on a starved machine more are on their way than ever before (seen: 14
  // more in 640 messages, beside compilers).
  if (transport == "cyclonedds") return (messages * (value.payload_bytes + 1024) >> 20) + messages / 16 + 8;
  // Fast DDS 2.9 allocates a node of its history for every message received. A reliable writer hands a
  // std::function to each step that it does for its readers: 10 for a message, 3 for an acknowledgement.
  if (transport == "fastdds")
    return (messages + 100) * (value.reliability == transport::Reliability::reliable ? 16 : 1);
  // OpenDDS 3.13 allocates 21 times for a message sent and 8 times for one received, 36 and 13 times where it
  // is in two fragments. Reliable, with acknowledgements and each step that a writer does for them, 66 times
  // for one received and answered, and 113 times in two fragments.
  if (transport == "opendds") {
    const bool fragments = value.payload_bytes > 60'000;
    const std::uint64_t each = value.reliability == transport::Reliability::reliable ? fragments ? 120 : 70
                               : fragments                                           ? 36 + 13
                                                                                     : 21 + 8;
    return (messages + 100) * each;
  }
  return 0;
}

// Cyclone DDS keeps a block of 1 MiB for as long as a message in it is not done with, be it that a fragment
// was to be sent again. One block more than it ever had at a time, and the arena of its thread grows by as
// much. A participant that background topics share keeps their messages too, until an ordinary thread has
// sent them or taken them: one more at a time than ever before, and its arena grows by what the C library
// takes at once (seen: 33 pages, beside compilers).
//
// A reliable writer of OpenDDS keeps each message until it is acknowledged, which it asks for once a second:
// whatever is sent in a second, in up to five copies of the payload, and its arenas grow and shrink by that
// (seen: 1.2 pages a message of 500 bytes, 82 of one of 64 KiB). What allocates for each message has its
// arena grow at times otherwise, too (seen: 9 pages, and 73 with background topics).
//
// The thread of Fast DDS that sends again sleeps until a message is lost. Only then does it allocate for the
// first time, and the C library gives it an arena of its own (seen: 33 pages in 1 of 40 runs beside two busy
// loops). Any that allocations_allowed() permits a DDS on a starved machine may be the one that its
// arena grows by.
std::uint64_t faults_allowed(const Case& value, std::uint64_t messages, const Thread& thread) {
  constexpr std::uint64_t blocks = 2, pages_of_a_block = 260, pages_of_an_arena = 33, page_bytes = 4096;
  if (value.transport == std::string("cyclonedds") && value.payload_bytes > 60'000)
    return blocks * pages_of_a_block;
  if (value.transport == std::string("opendds")) {
    if (value.reliability == transport::Reliability::reliable)
      return (messages + 100) * (6 * value.payload_bytes / page_bytes + 2);
    return 3 * pages_of_an_arena;
  }
  const bool is_dds =
      value.transport == std::string("cyclonedds") || value.transport == std::string("fastdds");
  const std::uint64_t arenas =
      (is_dds ? 1 : 0) + (value.background ? 2 : 0) + (thread.role == "resend" ? 1 : 0);
  return arenas * pages_of_an_arena;
}

std::uint64_t waits_allowed(const Case& value, std::uint64_t cycles) {
  const std::string transport = value.transport;
  const std::size_t datagram = transport == "cyclonedds" ? 14'000 : 65'000;  // about
  std::uint64_t waits = value.payload_bytes / datagram + 1;
  // A heartbeat, and its acknowledgement.
  if (value.reliability == transport::Reliability::reliable) waits += 2;
  // The waitsets of both hand a lock from their receiving thread to ours.
  if (value.receive == transport::Receive::waitset && !is_below_ip(value) && transport != "udp") waits += 3;
  // OpenDDS asks for its acknowledgements in bursts, and what sends waits for what answers them.
  if (transport == "opendds" && value.reliability == transport::Reliability::reliable) waits += 4;
  // The sender of back-to-back also looks for losses a hundred times a second.
  return (cycles + 100) * waits;
}

}  // namespace
}  // namespace ontime::roundtrip

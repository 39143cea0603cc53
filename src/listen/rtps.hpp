// SPDX-License-Identifier: Apache-2.0
// RTPS, the wire protocol of DDS: reads the writers' messages in a datagram (OMG DDSI-RTPS 2.3, section 9.4).
// Pure; any bytes are valid input, and none are kept.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>

namespace ontime::listen::rtps {

struct Guid {
  std::array<std::uint8_t, 16> bytes{};
  auto operator<=>(const Guid&) const = default;  // NOLINT(modernize-use-nullptr): it means <=> 0
  bool is_user_endpoint() const { return (bytes[15] & 0xc0U) == 0; }
};
std::string text_of(const Guid&);  // "01100a2b.8f5c1d20.00000001:00001203"

struct Fragments {
  std::uint32_t first = 1, count = 0, total = 0;  // numbered from 1
};

struct Data {
  Guid writer;
  std::uint64_t sequence = 0;            // from 1
  std::optional<std::int64_t> stamp_ns;  // the writer's source time stamp: CLOCK_REALTIME of its machine
  std::optional<Fragments> fragments;    // empty: the message is in this datagram as a whole
  std::span<const std::byte> payload;    // as far as the datagram has it
};

// Numbers that are no messages, or that the writer will not send to this reader.
struct Gap {
  Guid writer;
  std::uint64_t first = 0, last = 0;
  bool is_end = false;  // of an instance: it is no message, for any reader
};

struct Heartbeat {
  Guid writer;
  std::uint64_t first = 0, last = 0;  // numbers that the writer still has; last < first: none
};

struct Visitor {
  std::function<void(const Data&)> data;
  std::function<void(const Gap&)> gap;
  std::function<void(const Heartbeat&)> heartbeat;
};

// Ignores datagrams that are not RTPS. The submessage that goes beyond the end is visited only if the capture
// cut the datagram: else it is invalid, and no reader takes it. So is a submessage with fewer bytes
// than the fragments that it states.
void visit(std::span<const std::byte> datagram, const Visitor&, bool is_cut = false);

// A writer or reader as announced by a discovery message.
struct Endpoint {
  Guid guid;
  std::string topic, type;
  bool is_reader = false;
};
// Reads a message of the built-in writers of publications and subscriptions; empty: another message, or one
// without a topic.
std::optional<Endpoint> announced(const Data&);

}  // namespace ontime::listen::rtps

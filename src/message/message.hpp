// SPDX-License-Identifier: Apache-2.0
// What travels: a sequence number and a payload of bytes, and its form on the wire.
// Everything here is real-time safe: no allocation, no system call.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

namespace ontime::message {

// ROS 2's name for ontime_msgs/msg/RoundTrip.
inline constexpr const char* type_name = "ontime_msgs::msg::dds_::RoundTrip_";

// A sequence number on the wire is the client's session (24 bits, random, so that clients sharing a topic
// tell their answers apart, from any server) and the message's index within it (40 bits: 34 years at 1
// kHz).
inline constexpr unsigned index_bits = 40;
inline constexpr std::uint64_t max_index = (std::uint64_t{1} << index_bits) - 1;
constexpr std::uint64_t sequence_of(std::uint32_t session, std::uint64_t index) noexcept {
  return (std::uint64_t{session} << index_bits) | (index & max_index);
}
constexpr std::uint32_t session_of(std::uint64_t sequence) noexcept {
  return static_cast<std::uint32_t>(sequence >> index_bits);
}
constexpr std::uint64_t index_of(std::uint64_t sequence) noexcept { return sequence & max_index; }
// What comes before the counted messages has a session of its own: the one that follows upon the client's.
constexpr std::uint32_t warm_up_session_of(std::uint32_t session) noexcept {
  return session_of(sequence_of(session + 1, 0));
}

// Plain CDR (XCDR1) of {uint64 seq; sequence<uint8> data}: 4 bytes of encapsulation, 8 of seq, 4 of length,
// data.
inline constexpr std::size_t cdr_overhead = 16;
// The least that a message takes on a link, whatever the transport: its CDR bytes behind an Ethernet header.
constexpr std::size_t least_frame_bytes(std::size_t payload_bytes) noexcept {
  constexpr std::size_t ethernet_header = 14;
  return ethernet_header + cdr_overhead + payload_bytes;
}
// Little-endian, into `cdr`, which must hold cdr_overhead + payload.size(). Returns the bytes written.
std::size_t encode(std::uint64_t sequence, std::span<const std::byte> payload,
                   std::span<std::byte> cdr) noexcept;

struct View {
  std::uint64_t sequence;
  std::span<std::byte> payload;  // points into the CDR bytes
};
// Either byte order; nothing if the bytes are not such a message.
std::optional<View> decode(std::span<std::byte> cdr) noexcept;

// An ontime server writes its own times into the first 16 bytes of the payload that it returns (a client
// sends zeros there). Nothing is written into, or read from, a shorter payload; an end that only echoes
// leaves zeros. Any program may answer: values that no clock can show are not times.
struct ServerTimes {
  std::int64_t received_ns;  // the server's CLOCK_MONOTONIC
  std::int64_t sent_ns;
};
inline constexpr std::size_t server_times_bytes = 16;
void put_server_times(std::span<std::byte> payload, ServerTimes times) noexcept;
std::optional<ServerTimes> server_times(std::span<const std::byte> payload) noexcept;

}  // namespace ontime::message

// SPDX-License-Identifier: Apache-2.0
#include "message/message.hpp"

#include <bit>
#include <cstring>

namespace ontime::message {
namespace {

static_assert(std::endian::native == std::endian::little, "the CDR below is written in native order");

constexpr std::byte cdr_big_endian{0};
constexpr std::byte cdr_little_endian{1};
// 36 years. A record takes no time beyond it.
constexpr std::int64_t longest_uptime_ns = std::int64_t{1} << 60;

template <typename T>
void put(std::byte* at, T value) noexcept {
  std::memcpy(at, &value, sizeof value);
}

template <typename T>
T get(const std::byte* at) noexcept {
  T value;
  std::memcpy(&value, at, sizeof value);
  return value;
}

}  // namespace

std::size_t encode(std::uint64_t sequence, std::span<const std::byte> payload,
                   std::span<std::byte> cdr) noexcept {
  cdr[0] = std::byte{0};
  cdr[1] = cdr_little_endian;
  cdr[2] = cdr[3] = std::byte{0};
  put(&cdr[4], sequence);
  put(&cdr[12], static_cast<std::uint32_t>(payload.size()));
  if (!payload.empty()) std::memcpy(&cdr[16], payload.data(), payload.size());
  return cdr_overhead + payload.size();
}

std::optional<View> decode(std::span<std::byte> cdr) noexcept {
  if (cdr.size() < cdr_overhead || cdr[0] != std::byte{0}) return {};
  auto sequence = get<std::uint64_t>(&cdr[4]);
  auto length = get<std::uint32_t>(&cdr[12]);
  if (cdr[1] == cdr_big_endian) {
    sequence = __builtin_bswap64(sequence);
    length = __builtin_bswap32(length);
  } else if (cdr[1] != cdr_little_endian) {
    return {};
  }
  if (length > cdr.size() - cdr_overhead) return {};  // more may follow: DDS pads to a multiple of four
  return View{sequence, cdr.subspan(cdr_overhead, length)};
}

void put_server_times(std::span<std::byte> payload, ServerTimes times) noexcept {
  if (payload.size() < server_times_bytes) return;
  put(&payload[0], times.received_ns);
  put(&payload[8], times.sent_ns);
}

std::optional<ServerTimes> server_times(std::span<const std::byte> payload) noexcept {
  if (payload.size() < server_times_bytes) return {};
  const ServerTimes times{get<std::int64_t>(&payload[0]), get<std::int64_t>(&payload[8])};
  if (times.received_ns <= 0 || times.sent_ns < times.received_ns || times.sent_ns > longest_uptime_ns)
    return {};
  return times;
}

}  // namespace ontime::message

// SPDX-License-Identifier: Apache-2.0
// Frames that anything on the network may have sent: two bytes of length before each.
#include "listen/packets.hpp"

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <span>

#include <pcap/dlt.h>

#include "listen/wire.hpp"

namespace listen = ontime::listen;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  std::span<const std::byte> rest(reinterpret_cast<const std::byte*>(data), size);
  constexpr int types[] = {DLT_EN10MB, DLT_LINUX_SLL, DLT_LINUX_SLL2, DLT_RAW};
  if (rest.empty()) return 0;
  const auto first = std::to_integer<unsigned>(rest[0]);
  rest = rest.subspan(1);
  listen::Packets packets(types[first % 4]);
  listen::Wire wire(
      {.deadline = std::chrono::milliseconds(1), .period = {}, .age = std::chrono::milliseconds(1)});
  std::int64_t at_ns = 0;
  while (rest.size() >= 2) {
    const auto length = std::min<std::size_t>(
        rest.size() - 2, std::to_integer<std::size_t>(rest[0]) << 8U | std::to_integer<std::size_t>(rest[1]));
    const auto frame = rest.subspan(2, length);
    rest = rest.subspan(2 + length);
    at_ns += 1'000'000;
    // Half of the inputs are datagrams, so that what is in them is reached too.
    if (first >= 128)
      wire.add(at_ns, {.source = "a", .destination = "b", .is_one_host = first % 2 == 0, .payload = frame});
    else if (const auto datagram = packets.datagram(frame))
      wire.add(at_ns, *datagram);
  }
  const auto findings = wire.findings();
  std::uint64_t messages = 0;
  for (const auto& flow : findings.flows) messages += flow.messages;
  if (messages > size) std::abort();  // none is made up
  return 0;
}

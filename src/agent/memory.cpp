// SPDX-License-Identifier: Apache-2.0
#include "agent/memory.hpp"

#include <algorithm>
#include <cstdint>

#include <fmt/format.h>

namespace ontime::agent {
namespace {

constexpr std::uint64_t mebibyte = std::uint64_t{1} << 20U;
constexpr std::uint64_t locked_bytes = 192 * mebibyte;  // 165 to 185 MB were seen
constexpr std::uint64_t most_reserve = 256 * mebibyte;

}  // namespace

std::string lacks_memory(std::istream& meminfo) {
  std::uint64_t total = 0, available = 0, kilobytes = 0;
  for (std::string word; meminfo >> word;) {
    if (word == "MemTotal:" && meminfo >> kilobytes) total = kilobytes * 1024;
    if (word == "MemAvailable:" && meminfo >> kilobytes) available = kilobytes * 1024;
  }
  const auto reserve = std::min(total / 20, most_reserve);
  if (total == 0 || available >= locked_bytes + reserve) return "";
  return fmt::format(
      "an end with locked memory takes {} MiB. This machine has {} MiB free, of which {} MiB stay free. Have "
      "fewer components on it, end what takes its memory, or set realtime.lock-memory: off",
      locked_bytes / mebibyte, available / mebibyte, reserve / mebibyte);
}

}  // namespace ontime::agent

// SPDX-License-Identifier: Apache-2.0
// Calculations with times of a damaged file, which may be any numbers: they wrap around instead of
// overflowing.
#pragma once

#include <cstdint>

namespace ontime::statistics {

constexpr std::int64_t between(std::int64_t earlier, std::int64_t later) {
  return static_cast<std::int64_t>(static_cast<std::uint64_t>(later) - static_cast<std::uint64_t>(earlier));
}
constexpr std::int64_t nth_after(std::int64_t ns, std::int64_t period_ns, std::uint64_t n) {
  return static_cast<std::int64_t>(static_cast<std::uint64_t>(ns) +
                                   static_cast<std::uint64_t>(period_ns) * n);
}
constexpr std::uint64_t most_trailing = std::uint64_t{1} << 48;  // more is no count of cycles

}  // namespace ontime::statistics

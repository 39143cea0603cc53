// SPDX-License-Identifier: Apache-2.0
// Times that may come from a damaged file.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>

namespace ontime::statistics {

// Nothing of a time that was not stated.
inline std::optional<std::int64_t> positive_ns(std::chrono::nanoseconds time) {
  return time.count() > 0 ? std::optional(time.count()) : std::nullopt;
}

// Times of a damaged file may be any numbers: what is beyond a clock's reach comes round, as it does there.
constexpr std::int64_t between(std::int64_t earlier, std::int64_t later) {
  return static_cast<std::int64_t>(static_cast<std::uint64_t>(later) - static_cast<std::uint64_t>(earlier));
}

constexpr std::int64_t nth_after(std::int64_t ns, std::int64_t period_ns, std::uint64_t n) {
  return static_cast<std::int64_t>(static_cast<std::uint64_t>(ns) +
                                   static_cast<std::uint64_t>(period_ns) * n);
}

}  // namespace ontime::statistics

// SPDX-License-Identifier: Apache-2.0
// What a run's record says. It may be from elsewhere: anything may be missing, or of another kind.
#pragma once

#include <cmath>
#include <cstdint>
#include <optional>
#include <string>

#include <nlohmann/json.hpp>

#include "record/record.hpp"

namespace ontime::statistics {

using record::at;

inline std::string text_of(const nlohmann::json& value) {
  return value.is_string() ? value.get<std::string>() : "";
}

inline std::optional<std::int64_t> integer_of(const nlohmann::json& value) {
  if (!value.is_number_integer()) return {};
  return value.get<std::int64_t>();
}

// Nothing of nothing, of less, or of more than a clock counts.
inline std::optional<std::int64_t> positive_ns(const nlohmann::json& number, double ns_each) {
  if (!number.is_number()) return {};
  const double ns = number.get<double>() * ns_each;
  if (!(ns >= 1 && ns < 9e18)) return {};
  return std::llround(ns);
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

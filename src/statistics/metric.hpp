// SPDX-License-Identifier: Apache-2.0
// The metrics of a run, one row each. To add a percentile, add a row.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

namespace ontime::statistics {

enum class Times { round_trip, response };

// Percentiles stand together, the lowest first.
enum class Figure { mean, p50, p90, p99, p99_9, p99_99, max, late, lost };

struct Metric {
  Figure figure;
  const char* name;          // in gates, tables and JSON
  std::uint64_t one_in = 0;  // of a percentile: one in `one_in` values is greater
  bool is_share = false;     // of messages; all others are times
  double share_above() const { return 1 / static_cast<double>(one_in); }
  // Of a percentile: the smallest rank among `n` values with at least this share of values at or below it. In
  // whole numbers, because 0.999 as a double is not exact.
  std::uint64_t rank_of(std::uint64_t n) const {
    return n / one_in * (one_in - 1) + (n % one_in * (one_in - 1) + one_in - 1) / one_in;
  }
};

inline constexpr std::array metrics{
    Metric{Figure::mean, "mean"},         Metric{Figure::p50, "p50", 2},
    Metric{Figure::p90, "p90", 10},       Metric{Figure::p99, "p99", 100},
    Metric{Figure::p99_9, "p99.9", 1000}, Metric{Figure::p99_99, "p99.99", 10000},
    Metric{Figure::max, "max"},           Metric{Figure::late, "late", 0, true},
    Metric{Figure::lost, "lost", 0, true}};
static_assert(std::ranges::all_of(metrics, [](const Metric& row) {
  return &row == &metrics[static_cast<std::size_t>(row.figure)];
}));

constexpr const Metric& metric_of(Figure figure) { return metrics[static_cast<std::size_t>(figure)]; }

// "response p99"
inline std::string name_of(Times times, Figure figure) {
  return (times == Times::response ? "response " : "") + std::string(metric_of(figure).name);
}

constexpr std::size_t first_percentile = static_cast<std::size_t>(Figure::p50);
inline constexpr std::span percentiles = std::span(metrics).subspan<first_percentile, 5>();
static_assert(std::ranges::all_of(metrics, [](const Metric& row) {
  return (row.one_in > 0) ==
         (row.figure >= percentiles.front().figure && row.figure <= percentiles.back().figure);
}));
// A percentile's place among them. Throws std::out_of_range, by at(), if the metric is not a percentile.
constexpr std::size_t place_of(Figure percentile) {
  return static_cast<std::size_t>(percentile) - first_percentile;
}

}  // namespace ontime::statistics

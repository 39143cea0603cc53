// SPDX-License-Identifier: Apache-2.0
// Series as latency comes, of known quantiles: independent, each near the one before, and in bursts. And what
// is made of one.
#pragma once

#include <cmath>
#include <cstdint>
#include <functional>
#include <random>
#include <string>
#include <vector>

#include "statistics/course.hpp"
#include "statistics/statistics.hpp"
#include "statistics/values.hpp"

namespace ontime::statistics {

struct Random : std::mt19937_64 {
  using std::mt19937_64::mt19937_64;
  std::normal_distribution<> deviate;
};
using Times_ns = std::vector<std::int64_t>;

inline double uniform(Random& random) { return static_cast<double>(random() >> 11) * 0x1p-53; }
inline double normal(Random& random) { return random.deviate(random); }
// About 1 ms, spread as latency is.
inline std::int64_t as_time(double deviate) { return std::llround(1e6 * std::exp(0.25 * deviate)); }
inline double share_below(double deviate) { return std::erfc(-deviate / std::sqrt(2)) / 2; }

struct Kind {
  std::string name;
  std::function<Times_ns(std::size_t, Random&)> series;
  std::function<double(double)> share_below;  // of deviates
  double quantile(double share) const {
    double low = -10, high = 20;
    for (int i = 0; i < 60; ++i) (share_below((low + high) / 2) < share ? low : high) = (low + high) / 2;
    return 1e6 * std::exp(0.25 * low);
  }
};

inline Kind autoregressive(const std::string& name, double rho) {
  const auto series = [rho](std::size_t count, Random& random) {
    Times_ns values(count);
    double deviate = normal(random);
    for (auto& value : values) {
      value = as_time(deviate);
      deviate = rho * deviate + std::sqrt(1 - rho * rho) * normal(random);
    }
    return values;
  };
  return {name, series, [](double deviate) { return share_below(deviate); }};
}

// Calm, and now and then a stretch in which all is slower: of so many messages on average.
inline Kind bursty(double calm, double burst) {
  constexpr double slower = 3;
  const auto series = [=](std::size_t count, Random& random) {
    Times_ns values(count);
    bool in_burst = uniform(random) < burst / (calm + burst);
    for (auto& value : values) {
      value = as_time(normal(random) + (in_burst ? slower : 0));
      if (uniform(random) < 1 / (in_burst ? burst : calm)) in_burst = !in_burst;
    }
    return values;
  };
  return {"bursty", series, [=](double deviate) {
            const double share = burst / (calm + burst);
            return share * share_below(deviate - slower) + (1 - share) * share_below(deviate);
          }};
}

inline std::vector<Kind> kinds() {
  return {autoregressive("independent", 0), autoregressive("autocorrelated", 0.9), bursty(450, 50)};
}

// A run of these round trips.
inline Summary run_of(const Times_ns& values) {
  Values all;
  Course course;
  for (const auto value : values) {
    all.add(value);
    course.add(value);
  }
  Ranks ranks(std::move(all));
  Summary summary;
  summary.sent = summary.on_time = values.size();
  summary.round_trip = ranks.distribution();
  summary.round_trip_certainty = certainty(course, ranks, summary.round_trip);
  return summary;
}

}  // namespace ontime::statistics

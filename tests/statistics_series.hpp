// SPDX-License-Identifier: Apache-2.0
// Series as latency comes, of known quantiles: independent, each near the one before, and in bursts. And what
// is made of one.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>
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
// A simulation is short in the ordinary tests; ONTIME_LONG_TESTS=1 makes it long.
inline int trials(int ordinarily, int at_length) {
  return std::getenv("ONTIME_LONG_TESTS") == nullptr ? ordinarily : at_length;
}

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
    double low = -20, high = 40;
    for (int i = 0; i < 60; ++i) (share_below((low + high) / 2) < share ? low : high) = (low + high) / 2;
    return 1e6 * std::exp(0.25 * low);
  }
  double mean() const {
    constexpr double step = 0.005;
    double sum = 0;
    for (double low = -20; low < 40; low += step)
      sum += 1e6 * std::exp(0.25 * (low + step / 2)) * (share_below(low + step) - share_below(low));
    return sum;
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

// --- series that a run hardly sees, or sees once ---

inline double deviate_of(double factor) { return std::log(factor) / 0.25; }

// A cause that strikes with this probability, and makes a message fifty times as long.
inline Kind rare(const std::string& name, double probability) {
  const auto series = [=](std::size_t count, Random& random) {
    Times_ns values(count);
    for (auto& value : values) value = as_time(normal(random)) * (uniform(random) < probability ? 50 : 1);
    return values;
  };
  return {name, series, [=](double deviate) {
            return (1 - probability) * share_below(deviate) +
                   probability * share_below(deviate - deviate_of(50));
          }};
}

// Once in so many messages the next ten wait together, the first of them for 20 to 40 ms.
inline Kind stalls(double every) {
  constexpr int length = 10;
  const auto series = [=](std::size_t count, Random& random) {
    Times_ns values(count);
    for (auto& value : values) value = as_time(normal(random));
    for (std::size_t i = 0; i < count; ++i) {
      if (uniform(random) >= 1 / every) continue;
      const double longest = 20e6 + 20e6 * uniform(random);
      for (std::size_t k = 0; k < length && i + k < count; ++k)
        values[i + k] = std::llround(longest - 1e6 * static_cast<double>(k));
    }
    return values;
  };
  return {"stalls", series, [=](double deviate) {
            const double ms = std::exp(0.25 * deviate), share = 1 - std::pow(1 - 1 / every, length);
            double stalled = 0;
            for (int k = 0; k < length; ++k) stalled += std::clamp((ms - 20 + k) / 20, 0.0, 1.0) / length;
            return (1 - share) * share_below(deviate) + share * stalled;
          }};
}

// 1/f noise: as much variance in every factor of four of time, up to 16,384 messages.
inline Kind one_over_f() {
  const auto series = [](std::size_t count, Random& random) {
    constexpr std::size_t octaves = 8;
    std::array<double, octaves> parts{}, remains{};
    for (std::size_t k = 0; k < octaves; ++k) {
      parts[k] = normal(random);
      remains[k] = std::exp(-std::pow(4, -static_cast<double>(k)));
    }
    Times_ns values(count);
    for (auto& value : values) {
      double sum = 0;
      for (std::size_t k = 0; k < octaves; ++k) {
        parts[k] = remains[k] * parts[k] + std::sqrt(1 - remains[k] * remains[k]) * normal(random);
        sum += parts[k];
      }
      value = as_time(sum / std::sqrt(octaves));
    }
    return values;
  };
  return {"1/f", series, share_below};
}

// Of two levels, the higher one with this share, each kept for about so many messages. Width 0: values are
// alike.
inline Kind two_levels(const std::string& name, double share, double kept, double factor, double width) {
  const auto series = [=](std::size_t count, Random& random) {
    Times_ns values(count);
    bool high = uniform(random) < share;
    for (auto& value : values) {
      value = as_time(width * normal(random) + (high ? deviate_of(factor) : 0));
      if (uniform(random) < 1 / (2 * kept * (high ? share : 1 - share))) high = !high;
    }
    return values;
  };
  return {name, series, [=](double deviate) {
            const auto below = [&](double of) {
              return width > 0 ? share_below(of / width) : of < 0 ? 0.0 : 1.0;
            };
            return (1 - share) * below(deviate) + share * below(deviate - deviate_of(factor));
          }};
}

// The median doubles half-way.
inline Kind regime_change() {
  const auto series = [](std::size_t count, Random& random) {
    Times_ns values(count);
    for (std::size_t i = 0; i < count; ++i) values[i] = as_time(normal(random)) * (i < count / 2 ? 1 : 2);
    return values;
  };
  return {"regime change", series, [](double deviate) {
            return 0.5 * share_below(deviate) + 0.5 * share_below(deviate - deviate_of(2));
          }};
}

inline std::vector<Kind> hard_kinds(double messages) {
  return {rare("1 in n", 1 / messages),
          rare("1 in 10 n", 0.1 / messages),
          stalls(1500),
          one_over_f(),
          two_levels("two modes", 0.4, messages / 40, 2, 0.4),
          two_levels("two slow modes", 0.4, messages / 10, 2, 0.4),
          two_levels("ties", 0.45, messages / 40, 2, 0),
          two_levels("slow ties", 0.45, messages / 10, 2, 0),
          regime_change()};
}

inline constexpr double timeout_ns = 1e9;

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
  summary.round_trip_certainty = certainty(course, ranks, summary.round_trip, timeout_ns);
  return summary;
}

}  // namespace ontime::statistics

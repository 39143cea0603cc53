// SPDX-License-Identifier: Apache-2.0
// Values in the order in which they came, to seven digits: four bytes each.
#pragma once

#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "statistics/confidence.hpp"
#include "statistics/values.hpp"

namespace ontime::statistics {

class Course {
 public:
  void add(std::int64_t value);
  void add_series(const Series&);  // a long one is kept as one

  // At most as many batches as there are of Batches, equally long but for series. For each threshold: with
  // the values above it as events, or those at or above it.
  enum class Count { above, at_or_above };
  std::vector<std::vector<Batch>> events(std::span<const std::int64_t> thresholds, Count) const;
  bool has_series() const { return !series_.empty(); }
  std::span<const float> values() const { return values_; }  // without the long series
  std::vector<Batch> sums() const;                           // instead of events the sum of the values

 private:
  // With what of_values(values of the batch) and of_series(series) give for events.
  template <class OfValues, class OfSeries>
  std::vector<Batch> batches(OfValues, OfSeries) const;

  std::vector<float> values_;
  std::vector<std::pair<std::size_t, Series>> series_;  // each with the number of values before it
};

// Of the distribution of the same values. `longest_ns`: no value can be longer; nothing: not known.
Certainty certainty(const Course&, Ranks&, const Distribution&, std::optional<double> longest_ns = {});

}  // namespace ontime::statistics

// SPDX-License-Identifier: Apache-2.0
// Values in the order in which they came, to seven digits: four bytes each.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "statistics/confidence.hpp"
#include "statistics/values.hpp"

namespace ontime::statistics {

class Course {
 public:
  void add(std::int64_t value);
  // As Values has it; a long one is kept as one.
  void add_series(std::int64_t least, std::int64_t step, std::uint64_t count);

  // At most as many batches as there are of Batches, equally long but for series. For each threshold: with
  // the values above it as events, or those at or above it.
  enum class Count { above, at_or_above };
  std::vector<std::vector<Batch>> events(std::span<const std::int64_t> thresholds, Count) const;
  bool has_series() const { return !series_.empty(); }
  std::span<const float> values() const { return values_; }  // without the long series
  std::vector<Batch> sums() const;                           // instead of events the sum of the values

 private:
  struct Series {
    std::size_t place;  // before this value
    Values::Series values;
  };
  template <class Use, class UseSeries>
  void each(Use, UseSeries) const;  // use(batch, its values), use(batch, series)
  std::size_t batches() const;

  std::vector<float> values_;
  std::vector<Series> series_;
};

// Of the distribution of the same values. `longest_ns`: no value can be longer; nothing: not known.
Certainty certainty(const Course&, Ranks&, const Distribution&, std::optional<double> longest_ns = {});

}  // namespace ontime::statistics

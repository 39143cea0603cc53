// SPDX-License-Identifier: Apache-2.0
// What is kept of a run's course while its samples go by.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "statistics/statistics.hpp"

namespace ontime::statistics {

// Cycles that passed without a message: when the first was due, and each further one a period later.
struct Cycles {
  // Those whose times are no clock's are taken as due at once.
  Cycles(std::int64_t due, std::int64_t period, std::uint64_t number);
  std::int64_t last_due_ns() const;
  std::int64_t due_ns, period_ns;
  std::uint64_t count;
};

class Timeline {
 public:
  // Nothing: the record does not say how long the run was to be.
  Timeline(std::int64_t start_ns, std::optional<std::int64_t> duration_ns);
  void message(const roundtrip::Sample&);
  void skipped(const Cycles&);
  void answered(const Cycles&, std::int64_t at_ns);
  std::int64_t slice_ns() const { return slice_ns_; }
  std::vector<Slice> slices() &&;

 private:
  std::size_t index_of(std::int64_t due_ns) const;
  Slice& at(std::size_t index);
  template <class Use>
  void each_slice(const Cycles&, Use);  // use(its slice, how many of them, when the first was due)
  void close();

  std::int64_t start_ns_, slice_ns_;
  std::vector<Slice> slices_;
  std::size_t current_ = 0;
  std::vector<std::int64_t> round_trips_;  // of the current slice
};

class WorstOnes {
 public:
  // Nothing: the record does not say after how long a message was given up.
  explicit WorstOnes(std::optional<std::int64_t> timeout_ns) : timeout_ns_(timeout_ns.value_or(0)) {}
  void message(const roundtrip::Sample&);
  std::vector<Worst> longest_first() &&;

 private:
  void keep(const Worst&);
  std::int64_t timeout_ns_;
  std::optional<roundtrip::Sample> last_;
  bool last_is_kept_ = false;
  std::vector<Worst> worst_;  // a heap, the shortest at its front
};

}  // namespace ontime::statistics

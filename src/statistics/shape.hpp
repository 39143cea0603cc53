// SPDX-License-Identifier: Apache-2.0
// Summarises how a run went over time, in one pass over its samples.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "statistics/values.hpp"

namespace ontime::statistics {

class Timeline {
 public:
  // Nothing: the record does not say how long the run was to be. At most 2,000 slices, however long it is.
  Timeline(std::int64_t start_ns, std::optional<std::int64_t> duration_ns);
  void message(const roundtrip::Sample&);
  void skipped(const Series& cycles);  // by when each was due
  void answered(const Series& cycles, std::int64_t at_ns);
  void into(Shape&) &&;

 private:
  void add(const roundtrip::Sample&);
  bool is_far(const roundtrip::Sample&) const;
  std::size_t index_of(std::int64_t due_ns);  // makes room for it
  void double_slices();
  Slice& at(std::size_t index);
  template <class Use>
  void each_slice(const Series& cycles, Use);  // use(its slice, how many of them, when the first was due)
  void close();

  std::int64_t start_ns_, slice_ns_;
  double stated_ns_;
  std::vector<Slice> slices_;
  std::vector<roundtrip::Sample> far_;  // until more come after so long a time
  std::size_t current_ = 0;
  bool lower_ = true;                      // which median the next merger keeps
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

// Which messages were late or lost, and their bursts.
class Misses {
 public:
  void message(const roundtrip::Sample&);
  void end_burst();
  // `effect`: of the slowest answers, for what hardly or never occurred.
  void into(Summary&, double effect) &&;

 private:
  Batches late_, lost_, missed_;
  Bursts bursts_;
  std::uint64_t in_a_row_ = 0;
  std::int64_t from_ns_ = 0;  // when the first of these was due
};

}  // namespace ontime::statistics

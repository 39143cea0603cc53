// SPDX-License-Identifier: Apache-2.0
// Which messages were late or lost, and how they follow upon one another.
#pragma once

#include <cstdint>
#include <optional>

#include "statistics/statistics.hpp"

namespace ontime::statistics {

class Misses {
 public:
  // Nothing: the record does not say after how long a message was given up.
  explicit Misses(std::optional<std::int64_t> timeout_ns) : timeout_ns_(timeout_ns.value_or(0)) {}
  void message(const roundtrip::Sample&);
  // `effect`: of the slowest answers, for what hardly or never occurred.
  void into(Summary&, double effect) &&;

 private:
  void close();
  std::int64_t timeout_ns_;
  Batches late_, lost_, missed_;
  Bursts bursts_;
  std::uint64_t in_a_row_ = 0;
  std::int64_t from_ns_ = 0, to_ns_ = 0;  // of these
};

}  // namespace ontime::statistics

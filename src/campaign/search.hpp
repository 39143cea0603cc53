// SPDX-License-Identifier: Apache-2.0
// Searches the values of a condition, from the gentlest to the harshest, for the last that passes and the
// first that misses. Steps double until a miss; then the interval is halved. It assumes that all values
// harsher than a miss miss as well.
#pragma once

#include <algorithm>
#include <optional>

namespace ontime::campaign {

class Search {
 public:
  explicit Search(int values) : missed_(values), values_(values) {}

  // The next to try, from 0; nothing once it is found.
  std::optional<int> next() const {
    if (missed_ - passed_ <= 1) return {};
    if (missed_ < values_) return (passed_ + missed_) / 2;
    return passed_ < 0 ? 0 : std::min(2 * passed_ + 1, values_ - 1);
  }
  // The result of next().
  void tell(bool missed) { (missed ? missed_ : passed_) = *next(); }

 private:
  int passed_ = -1, missed_;
  int values_;
};

}  // namespace ontime::campaign

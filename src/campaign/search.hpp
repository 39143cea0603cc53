// SPDX-License-Identifier: Apache-2.0
// How far a condition can be turned up: which of its values, from the gentlest to the harshest, is the last
// at which nothing is missed, and which the first at which something is. It goes up in steps that double
// until something is missed, and halves what is between: it supposes that whatever misses at one value misses
// at harsher ones.
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
  // What came of next().
  void tell(bool missed) { (missed ? missed_ : passed_) = *next(); }

 private:
  int passed_ = -1, missed_;
  int values_;
};

}  // namespace ontime::campaign

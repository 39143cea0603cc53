// SPDX-License-Identifier: Apache-2.0
// How far a condition can be turned up: which of its values, from the gentlest to the harshest, is the last
// at which nothing is missed, and which the first at which something is. It goes up in steps that double
// until something is missed, and halves what is between: it supposes that whatever misses at one value misses
// at harsher ones.
#pragma once

#include <algorithm>
#include <optional>

#include <nlohmann/json.hpp>

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

  // Nothing: none of them did.
  std::optional<int> passed() const { return passed_ < 0 ? std::nullopt : std::optional(passed_); }
  std::optional<int> missed() const { return missed_ == values_ ? std::nullopt : std::optional(missed_); }

 private:
  int passed_ = -1, missed_;
  int values_;
};

// Of a run's outcome: whether it ends a search. A message was late or lost, or a cycle passed without one; it
// failed; or what was asked for beside it (neighbours, traffic, load, the link's faults) was not there, and
// will not be with more.
bool ends_search(const nlohmann::json& asked, const nlohmann::json& outcome);

}  // namespace ontime::campaign

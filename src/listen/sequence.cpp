// SPDX-License-Identifier: Apache-2.0
#include "listen/sequence.hpp"

#include <algorithm>

namespace ontime::listen {

void Sequence::advance(std::uint64_t next, bool are_missing) {
  const auto count = next - *next_;
  if (count >= window) {
    gone_ += missing_.count() + (are_missing ? count - window : 0);
    missing_.reset();
    passed_over_.reset();
    (are_missing ? missing_ : passed_over_).set();
  } else {
    for (auto number = *next_; number < next; ++number) {
      if (missing_.test(number % window)) ++gone_;
      missing_.set(number % window, are_missing);
      passed_over_.set(number % window, !are_missing);
    }
  }
  next_ = next;
}

Sequence::Fate Sequence::see(std::uint64_t number) {
  if (!next_) {
    next_ = number + 1;
    first_ = number;
    return Fate::in_order;
  }
  if (number >= *next_) {
    advance(number + 1, true);
    missing_.reset(number % window);
    return Fate::in_order;
  }
  if (!is_within(number)) return Fate::too_old;
  if (!missing_.test(number % window) && !passed_over_.test(number % window)) return Fate::again;
  missing_.reset(number % window);
  passed_over_.reset(number % window);
  return Fate::overtaken;
}

void Sequence::announce(std::uint64_t last) {
  if (next_ && last >= *next_) advance(last + 1, true);
}

void Sequence::pass_over(std::uint64_t first, std::uint64_t last) {
  if (!next_ || last < first) return;
  // A writer numbers without holes: numbers that it did not pass over exist.
  if (first > *next_) advance(first, true);
  const auto oldest = std::max(first, *next_ > window ? *next_ - window : 0);
  for (auto number = oldest; number <= last && number < *next_; ++number)
    if (is_missing(number)) {
      missing_.reset(number % window);
      passed_over_.set(number % window);
    }
  if (last >= *next_) advance(last + 1, false);
}

void Sequence::keep_losses() {
  gone_ += missing_.count();
  missing_.reset();
}

void Sequence::restart() {
  keep_losses();
  passed_over_.reset();
  next_.reset();
}

}  // namespace ontime::listen

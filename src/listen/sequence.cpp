// SPDX-License-Identifier: Apache-2.0
#include "listen/sequence.hpp"

#include <algorithm>

namespace ontime::listen {

void Sequence::advance(std::uint64_t next, bool are_missing) {
  const auto count = next - *next_;
  if (count >= window) {
    gone_ += missing_.count() + (are_missing ? count - window : 0);
    missing_.reset();
    if (are_missing) missing_.set();
  } else {
    for (auto number = *next_; number < next; ++number) {
      if (missing_.test(number % window)) ++gone_;
      missing_.set(number % window, are_missing);
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
  if (number < first_ || *next_ - number > window) return Fate::too_old;
  if (!missing_.test(number % window)) return Fate::again;
  missing_.reset(number % window);
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
  for (auto number = oldest; number <= last && number < *next_; ++number) missing_.reset(number % window);
  if (last >= *next_) advance(last + 1, false);
}

void Sequence::restart() {
  gone_ += missing_.count();
  missing_.reset();
  next_.reset();
}

}  // namespace ontime::listen

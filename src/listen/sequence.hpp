// SPDX-License-Identifier: Apache-2.0
// Which numbers of a writer's messages were seen, and which are missing. Memory is constant.
#pragma once

#include <bitset>
#include <cstdint>
#include <optional>

namespace ontime::listen {

class Sequence {
 public:
  static constexpr std::uint64_t window = 4096;  // how far behind the latest number a message may arrive

  enum class Fate : std::uint8_t {
    in_order,   // later than all before; those between are missing from now on
    overtaken,  // it was missing or passed over, and came after all
    again,      // it was there
    too_old     // behind the window, or before the first
  };
  Fate see(std::uint64_t number);
  // These numbers, the last included, exist: those not seen are missing.
  void announce(std::uint64_t last);
  // Those of these numbers that were not seen need not come, and are not lost.
  void pass_over(std::uint64_t first, std::uint64_t last);
  // Losses until now stay, even of numbers that come.
  void keep_losses();
  // Restarts with the next number seen; losses until now stay.
  void restart();
  bool has_begun() const { return next_.has_value(); }
  bool is_missing(std::uint64_t number) const {  // of those within the window
    return is_within(number) && missing_.test(number % window);
  }
  std::uint64_t next() const { return next_.value_or(0); }
  std::uint64_t lost() const { return gone_ + missing_.count(); }

 private:
  bool is_within(std::uint64_t number) const {
    return next_ && number >= first_ && number < *next_ && *next_ - number <= window;
  }
  // To this next number; those on the way are missing, or passed over.
  void advance(std::uint64_t next, bool are_missing);
  std::optional<std::uint64_t> next_;
  std::uint64_t first_ = 0;
  std::bitset<window> missing_, passed_over_;  // by number modulo window
  std::uint64_t gone_ = 0;                     // missing for good
};

}  // namespace ontime::listen

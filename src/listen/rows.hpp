// SPDX-License-Identifier: Apache-2.0
// Numbers a flow's messages for a results file: without holes where the sensor was blind. A late message gets
// the number of its loss.
#pragma once

#include <algorithm>
#include <bitset>
#include <cstdint>
#include <functional>
#include <utility>

#include "listen/listen.hpp"
#include "listen/sequence.hpp"

namespace ontime::listen {

using KeepRow = std::function<void(const Row&)>;  // may be empty: nothing is kept

// Rows of packets and of a reader of ontime's own are timed by CLOCK_REALTIME; in a results file they begin
// near zero.
class Origin {
 public:
  void begin(std::int64_t at_ns) {  // the first call counts
    if (ns_ == 0) ns_ = at_ns - 1'000'000'000;
  }
  // Lives no longer than this.
  KeepRow shifted(KeepRow keep) const {
    return [this, keep = std::move(keep)](Row row) {
      row.from_ns -= ns_;
      if (row.to_ns != 0) row.to_ns -= ns_;
      keep(row);
    };
  }

 private:
  std::int64_t ns_ = 0;
};

// Counts a period, and keeps its row.
inline void add_period(Distribution& periods, const KeepRow& keep, std::uint64_t flow, std::int64_t from_ns,
                       std::int64_t to_ns, bool is_late) {
  if (keep) keep({flow, Row::Quantity::period, periods.count(), from_ns, to_ns, is_late});
  periods.add(to_ns - from_ns);
}

// Numbers the ages of a flow.
class Rows {
 public:
  // Adds the writer's message of this number. Numbers between it and the last one are lost: lost_at() gives
  // the time of publish, or 0: not lost. A message that is not judged has no row.
  template <class LostAt>
  void age(const KeepRow& keep, Row row, std::uint64_t number, const LostAt& lost_at, bool is_judged = true) {
    if (!keep) return;
    if (is_broken_) {
      first_number_ = number;
      first_ = next_;
      is_broken_ = false;
    }
    if (number < first_number_) return;
    row.quantity = Row::Quantity::age;
    row.index = number - first_number_ + first_;
    // Older losses are only counted: after a day's stop of the reader, or numbers made up by other programs.
    if (row.index > Sequence::window) next_ = std::max(next_, row.index - Sequence::window);
    for (; next_ < row.index; ++next_) {
      lost_.reset(next_ % Sequence::window);
      if (const auto at_ns = lost_at(next_ - first_ + first_number_); at_ns != 0)
        keep_lost(keep, row.flow, next_, at_ns);
    }
    const auto at = row.index % Sequence::window;
    if (next_ == row.index)
      ++next_;
    else
      row.was_lost = lost_.test(at);
    lost_.reset(at);
    if (is_judged || row.was_lost) keep(row);
  }
  // A lower number than the last one, only now known to be lost.
  void lost(const KeepRow& keep, std::uint64_t flow, std::uint64_t number, std::int64_t at_ns) {
    if (keep && !is_broken_ && number >= first_number_)
      keep_lost(keep, flow, number - first_number_ + first_, at_ns);
  }
  // The numbers between the last one and the next one are unknown.
  void restart() { is_broken_ = true; }

 private:
  void keep_lost(const KeepRow& keep, std::uint64_t flow, std::uint64_t index, std::int64_t at_ns) {
    lost_.set(index % Sequence::window);
    keep({.flow = flow, .quantity = Row::Quantity::age, .index = index, .from_ns = at_ns});
  }

  std::uint64_t next_ = 0;                      // index
  std::uint64_t first_number_ = 0, first_ = 0;  // a number and its index
  bool is_broken_ = true;
  std::bitset<Sequence::window> lost_;  // indices below next_ with a row of a loss, by index modulo window
};

}  // namespace ontime::listen

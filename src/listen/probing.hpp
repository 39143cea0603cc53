// SPDX-License-Identifier: Apache-2.0
// When ontime set or removed probes. The kernel may delay threads while it changes their code: messages late
// by that are not judged.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <utility>

namespace ontime::listen {

// CLOCK_MONOTONIC; in order of time. Messages are judged soon after they came: only the latest times are
// kept.
class Probing {
 public:
  void add(std::int64_t from_ns, std::int64_t to_ns) {
    if (times_.size() == most_kept) times_.pop_front();
    times_.emplace_back(from_ns, to_ns);
  }
  enum class Verdict : std::uint8_t { on_time, late, not_judged };
  // Not judged: ontime may have caused the excess over the limit, or made most of this time. Late: above the
  // limit even without ontime's part.
  template <class IsBeyond>
  Verdict judge(std::int64_t from_ns, std::int64_t to_ns, const IsBeyond& is_beyond) const {
    const auto own_ns = within(from_ns, to_ns), all_ns = to_ns - from_ns;
    if (is_beyond(all_ns - own_ns)) return Verdict::late;
    return own_ns > 0 && (is_beyond(all_ns) || 2 * own_ns >= all_ns) ? Verdict::not_judged : Verdict::on_time;
  }
  // Whether ontime made most of the time in which a message was lost.
  bool is_most_of(std::int64_t from_ns, std::int64_t to_ns) const {
    return judge(from_ns, to_ns, [](std::int64_t) { return false; }) == Verdict::not_judged;
  }

 private:
  static constexpr std::size_t most_kept = 1024;
  std::int64_t within(std::int64_t from_ns, std::int64_t to_ns) const {
    std::int64_t sum_ns = 0;
    for (auto time = times_.rbegin(); time != times_.rend() && time->second > from_ns; ++time)
      sum_ns += std::max<std::int64_t>(std::min(to_ns, time->second) - std::max(from_ns, time->first), 0);
    return sum_ns;
  }
  std::deque<std::pair<std::int64_t, std::int64_t>> times_;
};

}  // namespace ontime::listen

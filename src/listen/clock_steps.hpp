// SPDX-License-Identifier: Apache-2.0
// Whether CLOCK_REALTIME was set while a sensor listened. One thread at a time.
#pragma once

#include <cstdint>
#include <cstdlib>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>

namespace ontime::listen {

// Steps of CLOCK_REALTIME: a larger change than those by which NTP and PTP slew it, a thousandth.
class ClockSteps {
 public:
  // `ahead_ns`: what it shows more than CLOCK_MONOTONIC, which shows `now_ns`. Returns by how much it was set
  // since the last call; 0: it was not.
  std::int64_t look(std::int64_t ahead_ns, std::int64_t now_ns) {
    const auto by_ns = ahead_ns - std::exchange(ahead_ns_, ahead_ns).value_or(ahead_ns);
    const auto since_ns = now_ns - std::exchange(looked_ns_, now_ns);
    if (std::abs(by_ns) <= least_ns + since_ns / 1000) return 0;
    add(by_ns);
    return by_ns;
  }
  // The same often: exactly() takes longer, and reads again what may be a step.
  template <class Exactly>
  std::int64_t look(std::int64_t about_ahead_ns, std::int64_t now_ns, Exactly exactly) {
    constexpr std::int64_t second_ns = 1'000'000'000;
    const bool may_be_one =
        !ahead_ns_ || now_ns - looked_ns_ >= second_ns || std::abs(about_ahead_ns - *ahead_ns_) > least_ns;
    return may_be_one ? look(exactly(), now_ns) : 0;
  }
  void add(std::int64_t by_ns) {
    ++count_;
    last_ns_ = by_ns;
  }
  void remark(std::vector<std::string>& remarks, const char* unknown) const {
    if (count_ == 0) return;
    const auto by_s = std::abs(static_cast<double>(last_ns_)) / 1e9;
    remarks.push_back(fmt::format(
        "the clock was set, or the machine slept, {} {:.{}f} s {}. {} across {} are unknown",
        count_ == 1 ? "once," : fmt::format("{} times, the last time", count_), by_s, by_s < 1 ? 3 : 1,
        last_ns_ < 0 ? "back" : "forward", unknown, count_ == 1 ? "this time" : "these times"));
  }

 private:
  static constexpr std::int64_t least_ns = 1'000'000;
  std::optional<std::int64_t> ahead_ns_;
  std::int64_t looked_ns_ = 0, last_ns_ = 0;
  std::uint64_t count_ = 0;
};

}  // namespace ontime::listen

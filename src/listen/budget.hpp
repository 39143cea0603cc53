// SPDX-License-Identifier: Apache-2.0
// Limits the share of one CPU that listening uses: says when to stop kernel events and when to pause. Pure.
#pragma once

#include <chrono>
#include <cstdint>

namespace ontime::listen {

// Listening goes in spans. At first a span that takes too much ends the recording of the kernel's events;
// after that, it ends with a pause, until the CPU time of both together is within the budget.
class Budget {
 public:
  using Time = std::chrono::nanoseconds;
  // A span lasts at least `shortest`, so that a writer can be recognized. It may use at once what the budget
  // allows for `balanced_within`.
  static constexpr Time shortest = std::chrono::seconds(3), balanced_within = std::chrono::seconds(10);

  // `share` of one CPU, above 0.
  Budget(double share, bool records_kernel_events, Time now, Time taken)
      : share_(share), records_kernel_events_(records_kernel_events), began_(now), span_{now, taken} {}

  enum class Step : std::uint8_t { none, drop_kernel_events, pause, resume };
  // `taken`: CPU time of the probes and of ontime since any time, the same one in all calls. The caller
  // follows the step.
  Step look(Time now, Time taken);

  double share() const { return share_; }
  bool is_paused() const { return paused_at_ != Time::max(); }
  std::uint64_t pauses() const { return pauses_; }
  double listened_share(Time now) const;  // of the time, 0 … 1

 private:
  double share_;
  bool records_kernel_events_;
  Time began_;
  struct {
    Time begin, taken;
  } span_;
  Time paused_at_ = Time::max(), paused_for_{0};
  std::uint64_t pauses_ = 0;
};

}  // namespace ontime::listen

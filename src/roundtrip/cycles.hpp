// SPDX-License-Identifier: Apache-2.0
// Which cycles of a duration get a message. It asks the sender for the time, so that a test can have a time
// of its own. Real-time safe as far as the sender is.
#pragma once

#include <algorithm>
#include <cstdint>

namespace ontime::roundtrip {

// A message about to be sent; see Sample.
struct Turn {
  std::int64_t intended_ns, due_ns, woke_ns;
  std::uint32_t skipped_cycles = 0;
  std::int64_t passed_wake_ns = 0;
};

// What is left after the last message.
struct Rest {
  std::uint64_t cycles = 0;  // that passed unused
  std::int64_t due_ns = 0;   // the first of them
  std::int64_t woke_ns = 0;  // when the sender ran again for the last of them
  bool held = false;         // and whether it then might not send
};

// Cycles begin at `first_ns`, `first_ns` + `period_ns` …, before `end_ns`. The sender:
//   void sleep_until(std::int64_t due_ns)     returns then, or later, or when stopped
//   std::int64_t now_ns()
//   std::int64_t stopped_ns()                 when it was told to stop; the largest number if it was not
//   bool may_send(std::int64_t now_ns)        whether there may be another message now
//   void post(const Turn&)                    only after may_send()
// A cycle whose successor was due before the sender ran again is past: it is skipped, and no message is sent
// for it afterwards. So a sender that was held up sends its present value once, as a robot would, not
// all that it missed in a burst. Each cycle that was due before the end, or before a stop, is thus sent in,
// or counted in the next message's skipped_cycles, or in what is returned.
template <typename Sender>
Rest walk(Sender& sender, std::int64_t first_ns, std::int64_t period_ns, std::int64_t end_ns) noexcept {
  auto intended_ns = first_ns;
  std::int64_t passed_wake_ns = 0;
  Rest rest;
  for (auto due_ns = first_ns; due_ns < end_ns; due_ns += period_ns) {
    sender.sleep_until(due_ns);
    const auto now_ns = sender.now_ns();
    const auto stopped_ns = sender.stopped_ns();
    end_ns = std::min(end_ns, stopped_ns);
    if (due_ns >= end_ns) break;
    rest.woke_ns = now_ns;
    rest.held = !sender.may_send(now_ns);
    auto wake_ns = now_ns - due_ns;
    if (const auto past = wake_ns / period_ns; past > 0) {
      passed_wake_ns = std::max(passed_wake_ns, wake_ns);
      due_ns += past * period_ns;
      wake_ns -= past * period_ns;
    }
    if (due_ns >= end_ns || stopped_ns <= now_ns) break;
    if (rest.held) {
      passed_wake_ns = std::max(passed_wake_ns, wake_ns);
      continue;
    }
    sender.post({.intended_ns = intended_ns,
                 .due_ns = due_ns,
                 .woke_ns = now_ns,
                 .skipped_cycles = static_cast<std::uint32_t>((due_ns - intended_ns) / period_ns),
                 .passed_wake_ns = passed_wake_ns});
    intended_ns = due_ns + period_ns;
    passed_wake_ns = 0;
  }
  if (intended_ns < end_ns) {
    rest.cycles = static_cast<std::uint64_t>((end_ns - intended_ns + period_ns - 1) / period_ns);
    rest.due_ns = intended_ns;
  }
  return rest;
}

}  // namespace ontime::roundtrip

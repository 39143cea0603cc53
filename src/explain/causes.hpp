// SPDX-License-Identifier: Apache-2.0
// The causes of delays and losses, their texts, and the settings that remove them: one table.
#pragma once

#include <string>
#include <vector>

namespace ontime::explain {

// Why the thread or packet that a message depended on was delayed.
enum class Cause {
  cpu,            // it waited for a CPU while another thread ran there
  not_preempted,  // it waited for a CPU although its priority was above that of the thread that had it
  interrupts,     // interrupts or softirqs took its CPU
  throttled,      // it was ready, and the scheduler did not let it run: a quota, or real-time throttling
  idle_cpu,       // it was ready, and no event shows that its CPU ran
  stopped,        // by a signal
  traced,         // stopped for a tracer (ptrace)
  frozen,         // by the freezer: of a cgroup, or of a suspend
  page_fault,     // it waited in the kernel for a page of its memory
  lock,           // it waited for a kernel lock
  disk,           // it waited in the kernel for a disk
  blocked,        // it waited in the kernel; the trace does not show for what
  waited,         // it had the message and slept: by itself, or until another thread woke it
  busy,           // it ran all that time
  timer,          // the timer that should have woken it came late
  queue,          // a queueing discipline held the packet
  dropped,        // the kernel dropped the packet
  unreachable,    // the kernel had no route or no neighbour entry for the packet
  link_down,      // an interface was down or had no carrier
  unknown
};
const char* word_of(Cause);

// A key of a scenario and the value that removes the cause. `value` may also be a rule for a person
// ("above the priority of X").
struct Setting {
  std::string key, value;
  bool operator==(const Setting&) const = default;
};

// What removes a cause. Both empty: no remedy is known.
struct Remedy {
  std::vector<Setting> settings{};
  std::string advice{};  // for a person: what cannot be set in a scenario
};

// What a thread waited for while it was in these kernel functions (see trace::Kind::waits).
Cause cause_of_wait(const std::string& functions);

}  // namespace ontime::explain

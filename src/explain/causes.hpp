// SPDX-License-Identifier: Apache-2.0
// The causes of delays and losses, in words, and the settings that remove them: one table.
#pragma once

#include <string>
#include <vector>

namespace ontime::explain {

// What was the matter with the thread, or the packet, that should have gone on.
enum class Cause {
  cpu,            // it waited for a CPU while another thread ran there
  not_preempted,  // it waited for a CPU although its priority was above that of the thread that had it
  interrupts,     // interrupts or softirqs took its CPU
  throttled,      // it was ready, and the scheduler did not let it run: a quota, or real-time throttling
  idle_cpu,       // it was ready, and no event shows that its CPU was alive
  stopped,        // by a signal
  traced,         // stopped for a tracer (ptrace)
  frozen,         // by the freezer: of a cgroup, or of a suspend
  page_fault,     // it waited in the kernel for a page of its memory
  lock,           // it waited for a lock of the kernel's
  disk,           // it waited in the kernel for a disk
  blocked,        // it waited in the kernel, no event shows for what
  waited,         // it had the message, and slept: of its own accord, or until another thread woke it
  busy,           // it ran, and took its time
  timer,          // the timer that should have woken it came late
  queue,          // a queueing discipline held the packet
  dropped,        // the kernel dropped the packet
  unreachable,    // the kernel had no way to send the packet
  link_down,      // an interface could carry nothing
  unknown
};
const char* word_of(Cause);

// A key of a scenario, and the value that removes the cause. For a person `value` may be a rule ("above
// X's").
struct Setting {
  std::string key, value;
  bool operator==(const Setting&) const = default;
};

// What removes a cause. Both empty: nothing that can be named.
struct Remedy {
  std::vector<Setting> settings{};
  std::string advice{};  // for a person: what no setting does
};

// What a thread waited for that was in these functions of the kernel (see trace::Kind::waits).
Cause cause_of_wait(const std::string& functions);

}  // namespace ontime::explain

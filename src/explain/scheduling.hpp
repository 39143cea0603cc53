// SPDX-License-Identifier: Apache-2.0
// Which thread ran on which CPU: from traced switches, and inferred from other events.
#pragma once

#include <cstdint>
#include <vector>

#include "trace/trace.hpp"

namespace ontime::explain {

// The kernel's priority of SCHED_OTHER with nice 0; assumed for threads without an event that states it.
inline constexpr std::int32_t ordinary_priority = 120;

// A switch, a waking or a move. For an inferred switch `event.at_ns` is the earliest possible time and
// `latest_ns` the latest; otherwise the two are equal.
struct Scheduled {
  trace::Event event;
  std::int64_t latest_ns;
};

// From events in order of time. Some kernels do not trace every switch (seen: 6.18 under Firecracker). So if
// another thread than the last one switched to makes an event on a CPU, a switch is inferred: after the last
// event of the earlier thread there, and after the new one was woken. The state of the earlier thread is then
// unknown (""). From before `begin_ns` only the events that give the state of CPUs and threads at that time
// are kept. There only switches from idle are inferred. A switch that is not the last one of its CPU is kept
// for the thread that left. The thread that came has left since: it becomes `no_thread`.
std::vector<Scheduled> scheduling_of(const std::vector<trace::Event>&, std::int64_t begin_ns);
inline constexpr std::int32_t no_thread = -1;

}  // namespace ontime::explain

// SPDX-License-Identifier: Apache-2.0
// Who came onto which CPU, where the kernel says it and where only what it says beside shows it.
#pragma once

#include <cstdint>
#include <vector>

#include "trace/trace.hpp"

namespace ontime::explain {

// The kernel's, of SCHED_OTHER with nice 0; of whom no event says another.
inline constexpr std::int32_t ordinary_priority = 120;

// A switch, a waking or a move. Of a switch that nothing says but what happened afterwards, `event.at_ns` is
// the earliest moment at which it can have been; otherwise the two times are the same.
struct Scheduled {
  trace::Event event;
  std::int64_t latest_ns;
};

// Of events in order of time. There are kernels that do not trace every switch (seen: 6.18 under
// Firecracker). So where an event on a CPU was made by another thread than the one that came there last, a
// switch is inferred: after what the one before did there last, and after the new one was woken. What the one
// before is at since is not known (""). Of the time before `begin_ns` only what the CPUs and threads are at
// then was kept. Only switches from idle are inferred there; a switch that is not the last of its CPU was
// kept for who left: who came is gone, and is `nobody` here.
std::vector<Scheduled> scheduling_of(const std::vector<trace::Event>&, std::int64_t begin_ns);
inline constexpr std::int32_t nobody = -1;

}  // namespace ontime::explain

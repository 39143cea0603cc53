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

// Of events in order of time. There are kernels that trace no switch by which a CPU leaves its idle thread
// (seen: 6.18 as it runs under Firecracker, on all CPUs but the first). So where an event on a CPU that is
// said to be idle was made by another thread, that thread came after whatever the idle thread did there last,
// and after it was woken. Before `begin_ns`, of which only what the CPUs and threads are at then was kept, a
// switch that is not the last of its CPU was kept for who left: who came then is gone, and is nobody here.
std::vector<Scheduled> scheduling_of(const std::vector<trace::Event>&, std::int64_t begin_ns);
inline constexpr std::int32_t nobody = -1;

}  // namespace ontime::explain

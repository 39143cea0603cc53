// SPDX-License-Identifier: Apache-2.0
// What a thread did while a message waited for it, from the events of its machine.
#pragma once

#include <cstdint>

#include "explain/delay.hpp"
#include "explain/timeline.hpp"

namespace ontime::explain {

// The time of a packet or wake-up without a delay.
inline constexpr std::int64_t at_once_ns = 20'000;

bool is_interrupts(const std::string& name);  // of those, one that stands for an interrupt

// Adds the delays of the thread. `whose` states the stage, the end, the thread and its role. `has_cpu`: the
// thread read the clock at the beginning, so it ran then, even if the kernel did not trace its switch from
// idle.
void follow(Delay&, const Timeline&, Part whose, std::int64_t from_ns, std::int64_t to_ns,
            bool has_cpu = false);

}  // namespace ontime::explain

// SPDX-License-Identifier: Apache-2.0
// What a thread was at while a message waited for it, from the events of its machine.
#pragma once

#include <cstdint>

#include "explain/delay.hpp"
#include "explain/timeline.hpp"

namespace ontime::explain {

// What packets and wake-ups take when nothing is in the way.
inline constexpr std::int64_t at_once_ns = 20'000;

bool is_interrupts(const std::string& name);  // of those, one that stands for an interrupt

// Adds what held the thread up. `whose` says the stage, the end, the thread and its role. `has_cpu`: the
// thread read its clock at the beginning, so that it ran then, though a kernel may not tell how it came to an
// idle CPU.
void follow(Delay&, const Timeline&, Part whose, std::int64_t from_ns, std::int64_t to_ns,
            bool has_cpu = false);

}  // namespace ontime::explain

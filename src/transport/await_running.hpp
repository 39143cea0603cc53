// SPDX-License-Identifier: Apache-2.0
// Whether a link runs.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <thread>

#include <net/if.h>

#include "transport/clock.hpp"

namespace ontime::transport {

enum class LinkState { absent, down, running };

// `flags()` is what the kernel says of it now (IFF_UP and others), or nothing if it is not there. The kernel
// tells a second late that a new link runs, and on a busy machine several, so for one that is up this waits.
template <typename Flags>
LinkState await_running(const Flags& flags) {
  const std::int64_t end_ns = now_ns() + 10'000'000'000;
  while (true) {
    const std::optional<unsigned> now = flags();
    if (!now) return LinkState::absent;
    if ((*now & IFF_UP) == 0) return LinkState::down;
    if ((*now & IFF_RUNNING) != 0) return LinkState::running;
    if (now_ns() > end_ns) return LinkState::down;
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
}

}  // namespace ontime::transport

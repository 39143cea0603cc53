// SPDX-License-Identifier: Apache-2.0
// Sleeping on the clock that all of a sample's times are read from. Real-time safe.
#pragma once

#include <atomic>
#include <cstdint>
#include <ctime>

#include <linux/futex.h>
#include <sched.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "transport/clock.hpp"

namespace ontime::roundtrip {

// Once by a thread that has its policy and is about to sleep. Kernels before 6.1.132, 6.6.84 and 6.12 add the
// timer slack (50 µs by default) to a futex wait of a real-time thread, too, where clock_nanosleep has none.
// An ordinary thread keeps its slack, as every program has it.
inline void wake_as_precisely_as_the_policy_allows() noexcept {
  if ((sched_getscheduler(0) & ~SCHED_RESET_ON_FORK) != SCHED_OTHER) prctl(PR_SET_TIMERSLACK, 1UL);
}

// An absolute sleep that another thread can end, for good unless it is reset. It sleeps on a futex rather
// than in clock_nanosleep, which only a signal could end; both wait on the same kind of kernel timer.
class Alarm {
 public:
  void sleep_until(std::int64_t at_ns) noexcept {
    const timespec at{at_ns / 1'000'000'000, at_ns % 1'000'000'000};
    while (rung_.load(std::memory_order_relaxed) == 0 && transport::now_ns() < at_ns)
      futex(FUTEX_WAIT_BITSET_PRIVATE, &at);
  }
  void wait() noexcept {
    while (rung_.load(std::memory_order_relaxed) == 0) futex(FUTEX_WAIT_BITSET_PRIVATE, nullptr);
  }
  void ring() noexcept {
    rung_.store(1);
    syscall(SYS_futex, &rung_, FUTEX_WAKE_PRIVATE, 0x7fffffff, nullptr, nullptr, 0);
  }
  void reset() noexcept { rung_.exchange(0); }  // by the sleeping thread, before it looks why it was rung
  bool rung() const noexcept { return rung_.load(std::memory_order_acquire) != 0; }

 private:
  void futex(int operation, const timespec* at) noexcept {
    syscall(SYS_futex, &rung_, operation, 0, at, nullptr, FUTEX_BITSET_MATCH_ANY);
  }
  std::atomic<std::uint32_t> rung_{0};
  static_assert(sizeof(std::atomic<std::uint32_t>) == sizeof(std::uint32_t));
};

}  // namespace ontime::roundtrip

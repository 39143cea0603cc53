// SPDX-License-Identifier: Apache-2.0
#include <utility>

#include <linux/perf_event.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "realtime/realtime.hpp"

namespace ontime::realtime {

InstructionCounter::InstructionCounter(pid_t tid) {
  perf_event_attr event{};
  event.size = sizeof event;
  event.type = PERF_TYPE_HARDWARE;
  event.config = PERF_COUNT_HW_INSTRUCTIONS;
  event.exclude_hv = 1;
  fd_ = static_cast<int>(syscall(SYS_perf_event_open, &event, tid, -1, -1, PERF_FLAG_FD_CLOEXEC));
}

InstructionCounter::~InstructionCounter() {
  if (fd_ >= 0) close(fd_);
}

InstructionCounter::InstructionCounter(InstructionCounter&& other) noexcept
    : fd_(std::exchange(other.fd_, -1)) {}

std::optional<std::uint64_t> InstructionCounter::value() const {
  std::uint64_t count = 0;
  if (fd_ < 0 || ::read(fd_, &count, sizeof count) != sizeof count) return {};
  return count;
}

}  // namespace ontime::realtime

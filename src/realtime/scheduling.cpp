// SPDX-License-Identifier: Apache-2.0
#include "realtime/scheduling.hpp"

#include <cerrno>

#include <sched.h>
#include <sys/syscall.h>
#include <unistd.h>

namespace ontime::realtime {

std::uint32_t kernel_policy_of(Policy policy) {
  constexpr std::uint32_t sched_deadline = 6;  // not in glibc's <sched.h>
  switch (policy) {
    case Policy::other:
      return SCHED_OTHER;
    case Policy::fifo:
      return SCHED_FIFO;
    case Policy::round_robin:
      return SCHED_RR;
    case Policy::deadline:
      return sched_deadline;
  }
  return SCHED_OTHER;
}

std::optional<Attributes> attributes_of(pid_t tid) {
  Attributes attributes{};
  if (syscall(SYS_sched_getattr, tid, &attributes, sizeof attributes, 0) != 0) return {};
  return attributes;
}

int set_attributes(pid_t tid, const Attributes& attributes) {
  return syscall(SYS_sched_setattr, tid, &attributes, 0) == 0 ? 0 : errno;
}

}  // namespace ontime::realtime

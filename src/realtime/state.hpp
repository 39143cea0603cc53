// SPDX-License-Identifier: Apache-2.0
// sched_setattr(2) and sched_getattr(2), for which glibc has no functions.
#pragma once

#include <cerrno>
#include <cstdint>
#include <optional>

#include <sys/syscall.h>
#include <sys/types.h>
#include <unistd.h>

#include "realtime/realtime.hpp"

namespace ontime::realtime {

// The kernel's struct sched_attr, first published form. Its own header clashes with glibc's <sched.h>.
struct Attributes {
  std::uint32_t size;
  Policy policy;
  std::uint64_t flags;
  std::int32_t nice;
  std::uint32_t priority;
  std::uint64_t runtime_ns, deadline_ns, period_ns;
};
static_assert(sizeof(Attributes) == 48);

inline std::optional<Attributes> attributes_of(pid_t tid) {
  Attributes attributes{};
  if (syscall(SYS_sched_getattr, tid, &attributes, sizeof attributes, 0) != 0) return {};
  return attributes;
}

// 0 or an errno.
inline int set_attributes(pid_t tid, const Attributes& attributes) {
  return syscall(SYS_sched_setattr, tid, &attributes, 0) == 0 ? 0 : errno;
}

}  // namespace ontime::realtime

// SPDX-License-Identifier: Apache-2.0
// sched_setattr(2) and sched_getattr(2), for which glibc has no functions.
#pragma once

#include <cstdint>
#include <optional>

#include <sys/types.h>

#include "realtime/realtime.hpp"

namespace ontime::realtime {

// The kernel's struct sched_attr, first published form. Its own header clashes with glibc's <sched.h>.
struct Attributes {
  std::uint32_t size, policy;
  std::uint64_t flags;
  std::int32_t nice;
  std::uint32_t priority;
  std::uint64_t runtime_ns, deadline_ns, period_ns;
};
static_assert(sizeof(Attributes) == 48);

std::uint32_t kernel_policy_of(Policy);
std::optional<Attributes> attributes_of(pid_t tid);
// 0 or an errno.
int set_attributes(pid_t tid, const Attributes&);

}  // namespace ontime::realtime

// SPDX-License-Identifier: Apache-2.0
// What starts threads as it is loaded gives them the privileges of the thread that loads it. LTTng's, behind
// ROS 2's trace points, block every signal, so that nothing could take privileges from them later.
#pragma once

#include <array>
#include <cstdint>
#include <future>

#include <linux/capability.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "transport/transport.hpp"

namespace ontime::transport::ros2 {

// Of this thread alone: priorities, and locked memory, are what an end still needs.
inline void keep_few_privileges() {
  constexpr std::uint32_t kept = (1U << CAP_SYS_NICE) | (1U << CAP_IPC_LOCK);
  __user_cap_header_struct header{_LINUX_CAPABILITY_VERSION_3, 0};
  std::array<__user_cap_data_struct, _LINUX_CAPABILITY_U32S_3> sets{};
  if (syscall(SYS_capget, &header, sets.data()) != 0) return;
  sets[0] = {.effective = sets[0].effective & kept, .permitted = sets[0].permitted & kept, .inheritable = 0};
  sets[1] = {};
  syscall(SYS_capset, &header, sets.data());
}

// What `load` returns, from a thread with few privileges. Where it throws Error there, once more with all of
// the caller's: the files may be in a folder that root reads by privilege only.
template <typename Load>
auto loaded_unprivileged(const Load& load) {
  try {
    return std::async(std::launch::async,
                      [&] {
                        keep_few_privileges();
                        return load();
                      })
        .get();
  } catch (const Error&) {
    return load();
  }
}

}  // namespace ontime::transport::ros2

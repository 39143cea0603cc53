// SPDX-License-Identifier: Apache-2.0
// Which thread of the RMW and its DDS does what.
#pragma once

#include <string>
#include <vector>

#include <sys/types.h>

#include "transport/transport.hpp"

namespace ontime::transport::ros2 {

// `created`: what came with the first node of the process, in order.
std::vector<Thread> threads_of(const std::string& rmw, const std::vector<pid_t>& created, int domain);

// Of this process, in order of their creation.
std::vector<Thread> named(const std::string& name, const std::string& role);

}  // namespace ontime::transport::ros2

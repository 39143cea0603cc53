// SPDX-License-Identifier: Apache-2.0
// Which thread of Fast DDS does what. 2.9 neither names its threads nor tells of them, so they are known by
// what they sleep on: a socket, whose port says what it receives, or an event.
#pragma once

#include <vector>

#include <sys/types.h>

#include "transport/transport.hpp"

namespace ontime::transport::fastdds {

// Of this process, in order of their creation.
std::vector<pid_t> tasks();

// Tells the threads of one participant by their role, given in order of their creation. A thread that does
// not sleep for a while is "other".
std::vector<Thread> tell_apart(const std::vector<pid_t>& threads, int domain);

}  // namespace ontime::transport::fastdds

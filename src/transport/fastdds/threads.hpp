// SPDX-License-Identifier: Apache-2.0
// The roles of Fast DDS's threads, which it does not list. 2.14 and 3 name them. Those of 2.9 are recognised
// by what they sleep on: a socket or a port of shared memory, whose number tells what it receives, or an
// event.
//
// The kernel shows this only for a dumpable process, which a program with file capabilities is not. There the
// order of their start tells: the timer, one thread for each receiving socket (first discovery's), and then
// the asynchronous sender.
#pragma once

#include <vector>

#include <sys/types.h>

#include "transport/transport.hpp"

namespace ontime::transport::fastdds {

// The roles of one participant's threads, which are given in order of their creation. A thread is "unknown"
// if neither the kernel (it may not sleep for a while) nor the order tells: there are more or fewer threads
// than this process has sockets at the domain's ports.
std::vector<Thread> tell_apart(const std::vector<pid_t>& threads, int domain);

}  // namespace ontime::transport::fastdds

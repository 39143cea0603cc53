// SPDX-License-Identifier: Apache-2.0
// Which thread of Fast DDS does what. 2.9 neither names its threads nor tells of them, so they are known by
// what they sleep on: a socket or a port of shared memory, whose number says what it receives, or an event.
//
// The kernel tells that only where this process is dumpable, which a program with file capabilities is not.
// There the order tells, in which a participant starts them: its timer, one thread for each socket that
// receives (first those of discovery), and then what sends asynchronously.
#pragma once

#include <vector>

#include <sys/types.h>

#include "transport/transport.hpp"

namespace ontime::transport::fastdds {

// Tells the threads of one participant by their role, given in order of their creation. A thread is "unknown"
// of which the kernel does not tell, or that does not sleep for a while, where there are more or fewer
// threads than this process has sockets in the domain's ports.
std::vector<Thread> tell_apart(const std::vector<pid_t>& threads, int domain);

}  // namespace ontime::transport::fastdds

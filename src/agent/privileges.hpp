// SPDX-License-Identifier: Apache-2.0
// What an agent may no longer do once its end is open: it reads what any host on the network sends.
#pragma once

#include <string>
#include <vector>

namespace ontime::agent {

// Every thread of this process keeps CAP_SYS_NICE (priorities of threads to come) and CAP_IPC_LOCK (memory
// that comes later is locked) of the capabilities that it has, and gains none by what it executes. Uses
// SIGXCPU, which middlewares leave their threads. Returns the threads that could not be reached: they keep
// all.
std::vector<std::string> drop_privileges();

}  // namespace ontime::agent

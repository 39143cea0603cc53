// SPDX-License-Identifier: Apache-2.0
// Drops an agent's privileges once its end is open, because it reads what any host on the network sends.
#pragma once

#include <string>
#include <vector>

namespace ontime::agent {

// Of its capabilities every thread of this process keeps only CAP_SYS_NICE (priorities of later threads),
// CAP_IPC_LOCK (locking of later memory) and, to count instructions, CAP_PERFMON: counters open later, once
// all threads are there. It gains none by exec. Uses SIGXCPU, which middlewares do not block. Returns the
// threads that did not react: they keep all.
std::vector<std::string> drop_privileges(bool count_instructions);

}  // namespace ontime::agent

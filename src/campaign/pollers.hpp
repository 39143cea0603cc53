// SPDX-License-Identifier: Apache-2.0
// Threads that look for messages without ever sleeping (busy-poll), at a real-time priority. Where they may
// run on every CPU and nothing throttles them, nothing else runs again: not even what would end the run.
#pragma once

#include <string>
#include <vector>

#include "campaign/machines.hpp"

namespace ontime::campaign {

// Of one machine, with the CPUs of each such thread (empty: any). Why they are refused; "": they are not.
std::string why_refused(const nlohmann::json& machine, bool throttled,
                        const std::vector<std::vector<int>>& cpus_of_threads);

// Throws Error{2}.
void check_pollers(const Together&, const Machines&);

}  // namespace ontime::campaign

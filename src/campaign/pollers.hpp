// SPDX-License-Identifier: Apache-2.0
// Threads that poll for messages without sleeping (busy-poll), at a real-time priority. If they occupy every
// CPU and are not throttled, nothing else can run, not even what ends the run.
#pragma once

#include <string>
#include <vector>

#include "campaign/machines.hpp"

namespace ontime::campaign {

// Whether the kernel stops real-time threads that take all of a period, once these settings are applied. What
// a machine does not tell counts as no.
bool is_throttled(const record::Machine&, const settings::Wishes& kernel);

// Why these threads are refused on a machine with that many CPUs (nothing: unknown), from the CPUs of each
// (empty: any); "": they are not.
std::string why_refused(std::optional<std::int64_t> cpus, bool throttled,
                        const std::vector<std::vector<int>>& cpus_of_threads);

// Throws Error{2}.
void check_pollers(const Together&, const Machines&);

}  // namespace ontime::campaign

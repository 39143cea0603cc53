// SPDX-License-Identifier: Apache-2.0
// What became of the ordinary topics beside the critical one.
#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "agent/agent.hpp"

namespace ontime::campaign {

// The end of a run as it is for neighbours in a process of their own: an ordinary one, whatever the critical
// topic's is.
agent::Task of_their_own(agent::Task);

// Of a run's outcome (`neighbours` of its hosts), each way: {sent, received, lost, refused, skipped_cycles,
// strays, overruns, short}. `short`: of what was asked for (in that duration, if the run was not stopped)
// under 95 % were sent, or arrived, whatever took them; or over 5 % of the callbacks took longer than their
// turns.
nlohmann::json achieved(const roundtrip::NeighbourOptions&, const nlohmann::json& outcome,
                        std::optional<std::chrono::nanoseconds> duration = {});
std::vector<std::string> shortfalls_of_neighbours(const nlohmann::json& achieved);  // for people

}  // namespace ontime::campaign

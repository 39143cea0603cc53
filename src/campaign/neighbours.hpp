// SPDX-License-Identifier: Apache-2.0
// What became of the ordinary topics beside the critical one.
#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "roundtrip/roundtrip.hpp"

namespace ontime::campaign {

// Of a run's outcome (`neighbours` of its hosts), each way: {sent, received, lost, refused, skipped_cycles,
// strays, overruns, short}. `short`: fewer were sent than were asked for, in that duration if the run was not
// stopped, because the sender overran its period or the transport refused them; or their callbacks took
// longer than their turns.
nlohmann::json achieved(const roundtrip::NeighbourOptions&, const nlohmann::json& outcome,
                        std::optional<std::chrono::nanoseconds> duration = {});
std::vector<std::string> shortfalls_of_neighbours(const nlohmann::json& achieved);  // for people

}  // namespace ontime::campaign

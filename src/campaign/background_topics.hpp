// SPDX-License-Identifier: Apache-2.0
// Background topics beside the measured one: what was achieved.
#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "agent/agent.hpp"

namespace ontime::campaign {

// The task of an end for background topics in a process of their own: without real-time settings.
agent::Task of_their_own(agent::Task);

// From a run's outcome (`neighbours` of its hosts), for each direction: {sent, received, lost, refused,
// skipped_cycles, strays, overruns, short}. `short`: less than 95 % of the requested messages (in that
// duration, if the run was not stopped) were sent or arrived, or over 5 % of the callbacks took longer than
// their share of the period.
nlohmann::json achieved(const roundtrip::BackgroundOptions&, const nlohmann::json& outcome,
                        std::optional<std::chrono::nanoseconds> duration = {});
std::vector<std::string> shortfalls_of_background(const nlohmann::json& achieved);  // for people

}  // namespace ontime::campaign

// SPDX-License-Identifier: Apache-2.0
// Background topics beside the measured one: what was achieved.
#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <vector>

#include "agent/agent.hpp"
#include "record/outcome.hpp"

namespace ontime::campaign {

// The task of an end for background topics in a process of their own: without real-time settings.
agent::Task of_their_own(agent::Task);

// From what the hosts of an outcome counted, for each direction. Short: less than 95 % of the requested
// messages (in that duration, if the run was not stopped) were sent or arrived, or over 5 % of the callbacks
// took longer than their share of the period. `arriving`: the share of the messages that the run's own link
// faults let arrive.
record::ByName<record::BackgroundSeen> achieved(const roundtrip::BackgroundOptions&, const record::Outcome&,
                                                std::optional<std::chrono::nanoseconds> duration = {},
                                                double arriving = 1);
std::vector<std::string> shortfalls_of_background(
    const record::ByName<record::BackgroundSeen>& achieved);  // for people

}  // namespace ontime::campaign

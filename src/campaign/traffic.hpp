// SPDX-License-Identifier: Apache-2.0
// Concurrent traffic of a run: its streams, and the rates that were achieved.
#pragma once

#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "campaign/campaign.hpp"

namespace ontime::campaign {

// The requested directions: "to_component", "to_controller".
std::vector<std::string> ways_of(const Traffic&);
// The UDP ports of the traffic at the components: the same at all.
std::vector<int> ports_of(const Together&);
// The stream at one of the two ends: the controller, or that component.
background::Stream stream_of(const Run&, const std::string& way, const std::string& end, const Hosts&);

// From what both keepers report, `by_host` controller and component, for each direction {asked_bit_s,
// sent_bit_s, received_bit_s, running, short}; null: unknown. `short`: less than 95 % of the requested rate
// arrived, the rate is unknown, or iperf3 died.
nlohmann::json achieved(const Traffic&, const nlohmann::json& by_host);
// A text for each direction that fell short, for people.
std::vector<std::string> shortfalls(const nlohmann::json& achieved);

}  // namespace ontime::campaign

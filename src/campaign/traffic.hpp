// SPDX-License-Identifier: Apache-2.0
// Concurrent traffic of a run: who sends what to whom, and what came of it.
#pragma once

#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "campaign/campaign.hpp"

namespace ontime::campaign {

// The ways that were asked for: "to_component", "to_controller".
std::vector<std::string> ways_of(const Traffic&);
// At the components, of what goes over one interface: the same of all that have any.
std::vector<int> ports_of(const Together&);
// As one of the two ends has it: the controller's, or that component's.
background::Stream stream_of(const Run&, const std::string& way, const std::string& end, const Hosts&);

// By what both keepers say, `by_host` controller and component, of each way {asked_bit_s, sent_bit_s,
// received_bit_s, running, short}: of what one end sent, what the other received; null where it is not known.
// Short is less than 95 % of what was asked, or less than is known.
nlohmann::json achieved(const Traffic&, const nlohmann::json& by_host);
// Of what fell short, for people; nothing if nothing did.
std::vector<std::string> shortfalls(const nlohmann::json& achieved);

}  // namespace ontime::campaign

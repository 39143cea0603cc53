// SPDX-License-Identifier: Apache-2.0
// Concurrent traffic of a run: its streams, and the rates that were achieved.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "background/background.hpp"
#include "campaign/campaign.hpp"

namespace ontime::campaign {

// The requested directions: "to_component", "to_controller".
std::vector<std::string> ways_of(const Traffic&);
// The UDP ports of the traffic at the components: the same at all.
std::vector<int> ports_of(const Together&);
// The stream at one of the two ends: the controller, or that component.
background::Stream stream_of(const Run&, const std::string& way, const std::string& end, const Hosts&);

// The share of datagrams of that payload that the run's own loss and cut of the link let arrive, if it lasted
// so long. Of a reliable writer, which sends what is lost again, but keeps only the last few, that of the cut
// alone.
double share_that_arrives(const Run&, std::chrono::nanoseconds lasted, std::uint64_t datagram_bytes,
                          bool is_reliable = false);
// For each direction, from what both keepers report, `by_host` controller and component. What the run's own
// link faults drop is no shortfall, and what they duplicate makes up for none.
record::ByName<record::TrafficSeen> achieved(const Run&, std::chrono::nanoseconds lasted,
                                             const nlohmann::json& by_host);
// A text for each direction that fell short, for people.
std::vector<std::string> shortfalls(const record::ByName<record::TrafficSeen>& achieved);

}  // namespace ontime::campaign

// SPDX-License-Identifier: Apache-2.0
// Chains of topics on the command line, in words, as JSON (docs/reference/json-listen.md) and as runs.
// Pure.
#pragma once

#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "listen/listen.hpp"

namespace ontime::app {

// Each text like "/scan,/map,latest:/cmd_vel@50ms". Throws campaign::Error{2}.
std::vector<listen::ChainWish> chains_of(const std::vector<std::string>& texts);

std::string text_of(const listen::Chain&);  // lines of at most 80 columns
nlohmann::ordered_json json_of(const listen::Chain&);
// Each path as a flow from the first publisher to the last reader, for a results file.
std::vector<listen::Flow> flows_of(const listen::Chain&);
// Of chains of which no message arrived: nodes that publish a topic, but do not take the one before it. In
// findings of all topics.
std::vector<std::string> breaks_of(const listen::Findings&);
std::size_t came_out(const listen::Chain&);
bool misses(const listen::Chain&);  // its limit, at least once

}  // namespace ontime::app

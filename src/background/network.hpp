// SPDX-License-Identifier: Apache-2.0
// The kernel's packet filter and queueing disciplines.
#pragma once

#include <string>
#include <vector>

#include <nlohmann/json.hpp>

namespace ontime::background {

// Has `nft` carry out these commands, all or none, in the caller's network namespace, and returns what it
// wrote. Throws Error with what it said, or with what to install.
std::string nft(const std::string& commands);
// All that there are of a kind of things: of "counter" what `nft --json list counters` says.
std::vector<nlohmann::json> nft_list(const std::string& kind);

// Runs iproute2's `tc` in the caller's network namespace, and returns its output. Throws Error if it fails.
std::string tc(const std::vector<std::string>& arguments);

}  // namespace ontime::background

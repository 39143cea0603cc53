// SPDX-License-Identifier: Apache-2.0
// The kernel's packet filter and queueing disciplines.
#pragma once

#include <string>
#include <vector>

namespace ontime::background {

// Has `nft` carry out these commands, all or none, in the caller's network namespace, and returns what it
// wrote. Throws Error with what it said, or with what to install.
std::string nft(const std::string& commands);
std::string nft_json(const std::string& commands);

// Runs iproute2's `tc` in the caller's network namespace, and returns its output. Throws Error if it fails.
std::string tc(const std::vector<std::string>& arguments);

}  // namespace ontime::background

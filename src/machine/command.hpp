// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace ontime::machine {

// Runs iproute2's `ip`, without a shell, and returns what it wrote. Throws Error with what it said if it
// fails, or with what to install if it is missing.
std::string ip(const std::vector<std::string>& arguments);
// As ip(), for `tc`.
std::string tc(const std::vector<std::string>& arguments);

}  // namespace ontime::machine

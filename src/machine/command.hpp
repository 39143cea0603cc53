// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <vector>

namespace ontime::machine {

// Runs iproute2's `ip`, without a shell, and returns what it wrote. Throws Error with what it said if it
// fails, or with what to install if it is missing.
std::string ip(const std::vector<std::string>& arguments);

// What another program says; nothing if it is not there, fails, or is not done within the limit (then it is
// killed).
std::optional<std::string> answer_of(const std::vector<std::string>& command, std::chrono::nanoseconds limit);

}  // namespace ontime::machine

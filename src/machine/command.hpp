// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <string>
#include <vector>

namespace ontime::machine {

// Runs `ip` or `tc`, without a shell, and returns its output. Throws Error with that output if it fails, or
// with the package to install. In a process group of its own: Ctrl-C does not stop a change half-way. Kills
// it after the limit: `ip` waits for ever where another program left a FIFO in /run/netns.
std::string iproute2(const std::vector<std::string>& command,
                     std::chrono::nanoseconds limit = std::chrono::seconds(30));

}  // namespace ontime::machine

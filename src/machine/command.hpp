// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace ontime::machine {

// Runs `ip` or `tc`, without a shell, and returns its output. Throws Error with that output if it fails, or
// with the package to install. In a process group of its own: Ctrl-C does not stop a change half-way.
std::string iproute2(const std::vector<std::string>& command);

}  // namespace ontime::machine

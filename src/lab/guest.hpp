// SPDX-License-Identifier: Apache-2.0
// The machine's files, and what it runs at boot.
#pragma once

#include <string>
#include <vector>

#include "lab/image.hpp"
#include "lab/kernel.hpp"
#include "lab/lab.hpp"

namespace ontime::lab {

// The second serial line carries: `up` after boot; the command's standard error; `ended` with the command's
// exit code and the machine's uptime in seconds.
inline constexpr const char* up = "ontime lab: up";
inline constexpr const char* ended = "ontime lab: ended ";

// All files: this ontime with its transports, the programs that it uses if this machine has them, the
// kernel's modules. Without a command: a shell at the console.
Image image_of(const Machine&, const Kernel&, const std::vector<std::string>& command,
               const std::vector<File>&);

}  // namespace ontime::lab

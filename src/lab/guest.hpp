// SPDX-License-Identifier: Apache-2.0
// What there is in the machine, and what it does when it starts.
#pragma once

#include <string>
#include <vector>

#include "lab/image.hpp"
#include "lab/kernel.hpp"
#include "lab/lab.hpp"

namespace ontime::lab {

// The first line of its second serial line, when it is up; then comes what the command writes to standard
// error; then this, with the command's exit code and for how many seconds the machine has been up.
inline constexpr const char* up = "ontime lab: up";
inline constexpr const char* ended = "ontime lab: ended ";

// Every file of it: this ontime and its transports, the programs that it uses where this machine has them,
// the modules of the kernel. No command: a shell at the console.
Image image_of(const Machine&, const Kernel&, const std::vector<std::string>& command,
               const std::vector<File>&);

}  // namespace ontime::lab

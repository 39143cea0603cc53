// SPDX-License-Identifier: Apache-2.0
// Files of /proc and /sys that hold one value.
#pragma once

#include <string>
#include <vector>

#include "journal/journal.hpp"

namespace ontime::settings {

// Without white space at its ends; nothing if there is no such file. Throws journal::Error if the kernel does
// not say.
journal::Value read_file(const std::string& path);
// In one go, as the kernel takes it. Throws journal::Error with what the kernel has against it.
void write_file(const std::string& path, const std::string& text);
std::vector<std::string> names_in(const std::string& folder);  // in order; none if there is no such folder
journal::Error trouble(const std::string& what, int error);

}  // namespace ontime::settings

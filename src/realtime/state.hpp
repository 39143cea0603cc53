// SPDX-License-Identifier: Apache-2.0
// What the files of /proc/self/task/TID say, as pure functions of their text.
#pragma once

#include <string>

#include "realtime/realtime.hpp"

namespace ontime::realtime {

// Fills in the faults. False if the text is not such a file.
bool parse_stat(const std::string& text, ThreadState&);
// The value behind "key:" in a file such as status; nothing if there is no such line.
std::optional<std::string> status_field(const std::string& text, const std::string& key);
// Empty if it cannot be read.
std::string text_of(const std::string& path);

}  // namespace ontime::realtime

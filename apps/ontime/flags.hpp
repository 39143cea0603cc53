// SPDX-License-Identifier: Apache-2.0
// Flags that several commands have, each with one word for it and one check.
#pragma once

#include <chrono>
#include <string>

#include "command.hpp"
#include "report/report.hpp"

namespace ontime::app {

// Refuses an empty value, which a script's unset variable is.
std::string given(const std::string& value);

Option* add_file(Command&, const char* flag, std::string& file, const char* help);
void add_output(Command&, std::string& file);         // --output FILE, of what goes to standard output else
void add_report_format(Command&, std::string& word);  // --format, for format_flag()
void add_full(Command&, bool& full);                  // --full: every table instead of the first screen
void add_format(Command&, std::string& word);         // --format, for is_json_flag()
// --interface NAME, or --peer HOST in its place.
void add_link(Command&, std::string& interface, std::string& peer, const char* interface_help);

// What stands there, checked. Each throws Error{2} that names the flag.
report::Format format_flag(const std::string& word);
bool is_json_flag(const std::string& word);
std::chrono::nanoseconds duration_flag(const std::string& flag, const std::string& text);

}  // namespace ontime::app

// SPDX-License-Identifier: Apache-2.0
// What people and programs read: the paper's table with percentiles added, JSON, CSV, Markdown, LaTeX.
// Ordinary thread; returns text, prints nothing.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "statistics/statistics.hpp"

namespace ontime::report {

enum class Format { table, json, csv, markdown, latex };
std::optional<Format> format_of(const std::string& word);

// On one line, and as UTF-8, whatever it was: what would steer a terminal, or show a text otherwise than it
// is (control characters, marks and overrides of direction, what cannot be seen), becomes '?'. For all that
// comes from elsewhere: a results file, the network. The forms for people below pass all their text through
// it.
std::string printable(const std::string& text);

// One row a run. docs/json.md describes the JSON; it is stable.
std::string render(const std::vector<statistics::Summary>&, Format);
// The threads of each run as the kernel said they were: policy, priority, affinity, faults, switches.
std::string render_threads(const std::vector<statistics::Summary>&, Format);

// What an end asked of its machine and did not get, for people; alike ones together.
std::vector<std::string> refusals_of(const nlohmann::json& end);

// What each layer costs a message, of runs that say what they add to: a waterfall.
std::string render_layers(const std::vector<statistics::Summary>&, Format);

}  // namespace ontime::report

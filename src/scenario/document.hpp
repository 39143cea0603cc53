// SPDX-License-Identifier: Apache-2.0
// Reads a YAML file within limits, because yaml-cpp limits neither stack nor memory.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include "scenario/scenario.hpp"

namespace ontime::scenario {

// Throws Error: file, line, column, message.
template <class... Values>
[[noreturn]] void fail_at(const std::string& file, const YAML::Mark& mark,
                          fmt::format_string<Values...> message, Values&&... values) {
  throw Error(fmt::format("{}:{}:{}: {}", file, mark.line + 1, mark.column + 1,
                          fmt::format(message, std::forward<Values>(values)...)));
}

// For a mistyped key: " (did you mean 'transport'?)", or else "; allowed keys: …".
std::string meant_of(const std::string& key, const std::vector<std::string>& keys);

// The scalar value of a key. Throws Error, as once_each() does for a key that occurs twice: YAML forbids it,
// but yaml-cpp uses the last.
std::string scalar_of(const std::string& file, const YAML::Node&, const std::string& key);
void once_each(const std::string& file, const YAML::Node& map);

// Adds a notice, unless there is one of that name.
void note_renamed(Notices&, const std::string& file, const YAML::Mark&, const std::string& earlier,
                  const std::string& current);

// The content of a file. Throws Error if it is too large.
std::string text_of(const std::string& file);

// Parses the text. Refuses aliases that contain themselves, and too many nodes or levels with aliases
// expanded.
YAML::Node document_of(const std::string& file, const std::string& text);

}  // namespace ontime::scenario

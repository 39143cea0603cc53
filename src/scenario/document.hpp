// SPDX-License-Identifier: Apache-2.0
// A YAML file, read within bounds: yaml-cpp itself has none that keep our stack and memory.
#pragma once

#include <string>

#include <yaml-cpp/yaml.h>

#include "scenario/scenario.hpp"

namespace ontime::scenario {

// Throws Error: file, line, column, message.
[[noreturn]] void fail_at(const std::string& file, const YAML::Mark&, const std::string& message);

// The word that stands there as the value of a key. Throws the same, as once_each() does for a key that is
// there twice: YAML forbids it, yaml-cpp lets the last one win.
std::string scalar_of(const std::string& file, const YAML::Node&, const std::string& key);
void once_each(const std::string& file, const YAML::Node& map);

// Adds a notice, unless there is one of that name.
void note_renamed(Notices&, const std::string& file, const YAML::Mark&, const std::string& earlier,
                  const std::string& current);

// All of a file, if that is not too much.
std::string text_of(const std::string& file);

// The document that the text is. Its aliases never lead back into themselves; with each standing for a copy
// of its own, it has no more nodes and levels than a walk through it has time and stack for.
YAML::Node document_of(const std::string& file, const std::string& text);

}  // namespace ontime::scenario

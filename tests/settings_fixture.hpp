// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <fstream>
#include <iterator>
#include <string>

#include "settings/settings.hpp"

namespace ontime::settings {

inline const Setting& setting(const std::string& name) {
  const auto all = table();
  return *std::find_if(all.begin(), all.end(), [&](const Setting& one) { return name == one.name; });
}

// A file's text, without line feeds at its end.
inline std::string text_of(const std::string& path) {
  std::ifstream file(path);
  std::string text(std::istreambuf_iterator<char>(file), {});
  text.erase(text.find_last_not_of('\n') + 1);
  return text;
}

}  // namespace ontime::settings

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <string>

#include "settings/settings.hpp"

namespace ontime::settings {

inline const Setting& setting(const std::string& name) {
  const auto all = table();
  return *std::find_if(all.begin(), all.end(), [&](const Setting& one) { return name == one.name; });
}

}  // namespace ontime::settings

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <vector>

#include "background/child.hpp"

namespace ontime::background {

// The living processes of this machine for which it holds.
inline std::vector<process::Stat> where(const std::function<bool(const process::Stat&)>& condition) {
  auto all = processes();
  std::erase_if(all, [&](const auto& process) { return process.has_ended() || !condition(process); });
  return all;
}

}  // namespace ontime::background

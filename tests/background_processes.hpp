// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <vector>

#include "background/child.hpp"

namespace ontime::background {

// The living processes of this machine for which it holds.
inline std::vector<Process> where(const std::function<bool(const Process&)>& condition) {
  auto all = processes();
  std::erase_if(all, [&](const Process& process) { return process.ended() || !condition(process); });
  return all;
}

}  // namespace ontime::background

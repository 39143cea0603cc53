// SPDX-License-Identifier: Apache-2.0
// The kernel's functions by their addresses.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace ontime::trace {

class Symbols {
 public:
  Symbols();  // takes some tens of milliseconds
  // "" where the kernel hides its addresses (kernel.kptr_restrict), or there is none there.
  const std::string& at(std::uint64_t address) const;

 private:
  std::vector<std::pair<std::uint64_t, std::string>> functions_;  // by where they begin
};

}  // namespace ontime::trace

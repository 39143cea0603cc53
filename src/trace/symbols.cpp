// SPDX-License-Identifier: Apache-2.0
#include "trace/symbols.hpp"

#include <algorithm>
#include <fstream>
#include <sstream>
#include <string_view>

namespace ontime::trace {

Symbols::Symbols() {
  functions_.emplace_back(0, "");
  std::ifstream file("/proc/kallsyms");
  std::string line;
  while (std::getline(file, line)) {
    std::istringstream words(line);
    std::uint64_t address = 0;
    std::string type, name;
    if (words >> std::hex >> address >> type >> name && address != 0 &&
        std::string_view("tTwW").find(type) != std::string_view::npos)
      functions_.emplace_back(address, std::move(name));
  }
  std::sort(functions_.begin(), functions_.end());
}

const std::string& Symbols::at(std::uint64_t address) const {
  const auto next =
      std::upper_bound(functions_.begin(), functions_.end(), address,
                       [](std::uint64_t where, const auto& function) { return where < function.first; });
  return std::prev(next)->second;
}

}  // namespace ontime::trace

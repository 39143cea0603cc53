// SPDX-License-Identifier: Apache-2.0
#include "lab/console.hpp"

#include <algorithm>
#include <string_view>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace ontime::lab {
namespace {

constexpr std::size_t most_lines = 30;          // a kernel panic and its trace take about 25
constexpr std::string_view cleared = "\033[K";  // starts a line that is rewritten

std::string bare(std::string line) {
  if (line.starts_with(cleared)) line.erase(0, cleared.size());
  return line;
}

}  // namespace

std::vector<std::string> Console::lines(bool at_end) {
  input_.clear();
  if (!input_.is_open()) input_.open(file_, std::ios::binary);
  std::vector<std::string> whole;
  for (char c = 0; input_.get(c);) {
    if (c == '\n') {
      whole.push_back(bare(std::exchange(part_, "")));
    } else if (c != '\r') {
      if (anew_) part_.clear();
      part_ += c;
    }
    anew_ = c == '\r';
  }
  if (at_end && !part_.empty()) whole.push_back(bare(std::exchange(part_, "")));
  return whole;
}

std::string Console::present() const { return bare(part_); }

std::string Console::tail() const {
  auto all = Console(file_).lines(true);
  std::erase(all, "");
  if (all.empty()) return "(nothing)";
  const auto first = all.end() - static_cast<std::ptrdiff_t>(std::min(all.size(), most_lines));
  return fmt::format("{}", fmt::join(first, all.end(), "\n"));
}

}  // namespace ontime::lab

// SPDX-License-Identifier: Apache-2.0
#include "background/process.hpp"

#include <cctype>
#include <filesystem>
#include <fstream>
#include <sstream>

namespace ontime::background {

std::optional<Process> parse_stat(const std::string& text) {
  const auto name_begin = text.find('(');
  const auto name_end = text.rfind(')');  // a name may hold parentheses itself
  if (name_begin == text.npos || name_end == text.npos || name_end < name_begin) return {};
  Process process{};
  std::istringstream number(text.substr(0, name_begin)), fields(text.substr(name_end + 1));
  process.name = text.substr(name_begin + 1, name_end - name_begin - 1);
  if (!(number >> process.pid) || !(fields >> process.state >> process.parent >> process.group)) return {};
  return process;
}

std::vector<Process> processes() {
  std::vector<Process> found;
  for (const auto& entry : std::filesystem::directory_iterator("/proc")) {
    if (std::isdigit(static_cast<unsigned char>(entry.path().filename().c_str()[0])) == 0) continue;
    std::ifstream file(entry.path() / "stat");
    std::string text;
    std::getline(file, text, '\0');
    if (auto process = parse_stat(text)) found.push_back(std::move(*process));
  }
  return found;
}

}  // namespace ontime::background

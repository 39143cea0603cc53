// SPDX-License-Identifier: Apache-2.0
#include "fitness/look.hpp"

#include <algorithm>
#include <filesystem>
#include <iterator>
#include <sstream>

#include "machine/proc.hpp"

namespace ontime::fitness {

namespace fs = std::filesystem;

std::optional<std::string> Look::text(const std::string& path) const {
  const auto all = machine::text_of(at(path));
  if (!all) return {};
  return machine::word(all).value_or("");
}

std::optional<std::int64_t> Look::number(const std::string& path) const {
  return machine::number(text(path));
}

std::vector<std::string> Look::names(const std::string& folder) const {
  std::vector<std::string> names;
  std::error_code none;
  for (const auto& entry : fs::directory_iterator(at(folder), none))
    names.push_back(entry.path().filename().string());
  std::sort(names.begin(), names.end());
  return names;
}

bool Look::exists(const std::string& path) const {
  std::error_code none;
  return fs::exists(at(path), none);
}

std::string Look::canonical(const std::string& path) const {
  std::error_code none;
  const auto found = fs::canonical(at(path), none).string(), root = fs::canonical(at("/"), none).string();
  if (found.empty()) return "";
  return root == "/" ? found : found.substr(std::min(found.size(), root.size()));
}

std::vector<Look::Thread> Look::threads(const std::string& prefix) const {
  constexpr std::size_t priority = 37, policy = 38;  // of /proc/PID/stat, counted from the state on
  std::vector<Thread> found;
  for (const auto& pid : names("/proc")) {
    if (!machine::number(pid)) continue;
    const auto stat = text("/proc/" + pid + "/stat").value_or("");
    const auto open = stat.find('('), close = stat.rfind(')');
    if (open == stat.npos || close == stat.npos) continue;
    const auto name = stat.substr(open + 1, close - open - 1);
    if (!name.starts_with(prefix)) continue;
    std::istringstream rest(stat.substr(close + 1));
    const std::vector<std::string> words(std::istream_iterator<std::string>(rest), {});
    if (words.size() <= policy) continue;
    const auto value_of = [&](std::size_t at) {
      return static_cast<int>(machine::number(words[at]).value_or(0));
    };
    found.push_back({name, value_of(policy), value_of(priority)});
  }
  return found;
}

}  // namespace ontime::fitness

// SPDX-License-Identifier: Apache-2.0
#include "fitness/look.hpp"

#include <algorithm>
#include <filesystem>

#include "machine/proc.hpp"
#include "process/process.hpp"

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
  std::vector<Thread> found;
  for (const auto& pid : names("/proc")) {
    if (!machine::number(pid)) continue;
    const auto stat = process::parse_stat(text("/proc/" + pid + "/stat").value_or(""));
    if (stat && stat->name.starts_with(prefix)) found.push_back({stat->name, stat->policy, stat->priority});
  }
  return found;
}

}  // namespace ontime::fitness

// SPDX-License-Identifier: Apache-2.0
#include "fitness/look.hpp"

#include <algorithm>
#include <filesystem>

#include "settings/file.hpp"

namespace ontime::fitness {

namespace fs = std::filesystem;

std::optional<std::string> Look::text(const std::string& path) const {
  const auto all = process::text_of(at(path));
  if (!all) return {};
  return process::word(all).value_or("");
}

std::optional<std::int64_t> Look::number(const std::string& path) const {
  return process::number(text(path));
}

std::vector<std::string> Look::names(const std::string& folder) const {
  return settings::names_in(at(folder));
}

bool Look::exists(const std::string& path) const {
  std::error_code none;
  return fs::exists(at(path), none);
}

std::vector<process::Stat> Look::processes() const {
  std::vector<process::Stat> found;
  for (const auto& pid : names("/proc"))
    if (process::number(pid))
      if (auto stat = process::parse_stat(text("/proc/" + pid + "/stat").value_or("")))
        found.push_back(*std::move(stat));
  return found;
}

std::vector<process::Stat> Look::kernel_threads(const std::string& prefix) const {
  auto found = processes();
  std::erase_if(found, [&](const auto& one) { return !one.is_of_kernel() || !one.name.starts_with(prefix); });
  return found;
}

bool Look::runs(const std::string& program) const {
  return std::ranges::any_of(processes(), [&](const auto& one) {
    if (one.name != program) return false;
    std::error_code unreadable;
    const auto process = "/proc/" + std::to_string(one.pid);
    const auto path = fs::read_symlink(at(process + "/exe"), unreadable);
    // Whose program cannot be read is another user's. Only root's is the real one.
    if (unreadable) return text(process + "/status").value_or("").find("\nUid:\t0\t") != std::string::npos;
    return path.filename() == program || path.filename() == program + " (deleted)";
  });
}

}  // namespace ontime::fitness

// SPDX-License-Identifier: Apache-2.0
#include "isolation/groups.hpp"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <sstream>

#include <fmt/format.h>

#include "realtime/realtime.hpp"
#include "settings/file.hpp"

namespace ontime::isolation {
namespace {

namespace fs = std::filesystem;
using settings::read_file;

bool has_word(std::string words, const std::string& word) {
  std::replace(words.begin(), words.end(), ',', ' ');
  std::istringstream all(words);
  const std::istream_iterator<std::string> end;
  return std::find(std::istream_iterator<std::string>(all), end, word) != end;
}

// Only the root group has the first file, and only the others have the second.
bool is_root(const Hierarchy& hierarchy) {
  return hierarchy.unified ? !fs::exists(hierarchy.folder + "/cgroup.type")
                           : fs::exists(hierarchy.folder + "/release_agent");
}

// Also "" if the group no longer exists.
std::string given_to(const fs::path& group) {
  try {
    return read_file(group / "cpuset.cpus").value_or("");
  } catch (const journal::Error&) {
    if (fs::exists(group)) throw;
    return "";
  }
}

}  // namespace

Hierarchy hierarchy_of(const std::string& controller, const std::string& mounts) {
  std::ifstream file(mounts);
  for (std::string line; std::getline(file, line);) {
    std::istringstream words(line);
    std::string device, type, options;
    Hierarchy found;
    words >> device >> found.folder >> type >> options;
    found.unified = type == "cgroup2";
    const bool has_it =
        found.unified ? has_word(read_file(found.folder + "/cgroup.controllers").value_or(""), controller)
                      : type == "cgroup" && has_word(options, controller);
    if (!has_it) continue;
    if (is_root(found)) return found;
    throw journal::Error(
        fmt::format("the control groups in {} are part of a larger hierarchy (in a container?). Fix: run on "
                    "the machine itself",
                    found.folder));
  }
  throw journal::Error(
      fmt::format("no control groups with controller '{0}' are mounted. Fix: mount -t cgroup2 none "
                  "/sys/fs/cgroup, if this kernel has that controller (/proc/cgroups)",
                  controller));
}

std::vector<std::string> owners_of(const Hierarchy& hierarchy, const std::vector<int>& cpus) {
  constexpr int tries = 20;
  std::vector<std::string> owners;
  std::error_code gone;  // a removed group ends the walk, which then starts again
  for (int i = 0; i < tries; ++i) {
    owners.clear();
    fs::recursive_directory_iterator entry(hierarchy.folder, gone);
    for (const fs::recursive_directory_iterator end; !gone && entry != end; entry.increment(gone)) {
      if (std::error_code none; !entry->is_directory(none)) continue;
      const auto given = realtime::cpus_of(given_to(entry->path()));
      if (given && std::ranges::find_first_of(*given, cpus) != given->end()) owners.push_back(entry->path());
    }
    if (gone) continue;
    std::sort(owners.begin(), owners.end());
    return owners;
  }
  throw journal::Error(
      fmt::format("cannot find the owners of the CPUs: control groups in {} keep changing: {}",
                  hierarchy.folder, gone.message()));
}

std::string folder_of(const std::string& group) {
  const auto slash = group.find('/');
  return fmt::format("{}/{}", hierarchy_of(group.substr(0, slash)).folder, group.substr(slash + 1));
}

}  // namespace ontime::isolation

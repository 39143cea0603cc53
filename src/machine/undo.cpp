// SPDX-License-Identifier: Apache-2.0
#include "machine/undo.hpp"

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <system_error>

#include <fmt/format.h>
#include <sys/mount.h>
#include <sys/stat.h>
#include <unistd.h>

#include "machine/machine.hpp"

namespace ontime::machine {

bool is_plain_name(const std::string& name) {
  const auto plain = [](unsigned char c) { return c > ' ' && c != '/' && c != 0x7f; };
  if (name.empty() || name.size() > 200 || name[0] == '.' || name[0] == '-') return false;
  return std::all_of(name.begin(), name.end(), plain);
}

std::string namespace_path(const std::string& name) { return "/run/netns/" + name; }

Undone remove_namespace(const std::string& name) {
  // As `ip netns delete`. The mount that goes here is the one of this mount namespace; unlinking the file
  // takes away those of all others, so this works from inside `ip netns exec`, too.
  const auto path = namespace_path(name);
  while (umount2(path.c_str(), MNT_DETACH | UMOUNT_NOFOLLOW) == 0) continue;
  if (unlink(path.c_str()) == 0) return Undone::done;
  if (errno == ENOENT) return Undone::nothing_there;
  throw Error(fmt::format("network namespace {} cannot be removed: {}", name,
                          std::generic_category().message(errno)));
}

Undone remove_directory(const std::string& path) {
  struct stat found {};
  if (lstat(path.c_str(), &found) != 0 && errno == ENOENT) return Undone::nothing_there;
  // Somebody else's would be a new one under an old name.
  if (!S_ISDIR(found.st_mode) || found.st_uid != geteuid()) return Undone::nothing_there;
  std::error_code error;
  std::filesystem::remove_all(path, error);
  if (error) throw Error(fmt::format("folder {} cannot be removed: {}", path, error.message()));
  return Undone::done;
}

}  // namespace ontime::machine

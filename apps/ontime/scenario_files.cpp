// SPDX-License-Identifier: Apache-2.0
#include "scenario_files.hpp"

#include <algorithm>
#include <cstdlib>
#include <system_error>
#include <utility>

#include <fmt/format.h>
#include <sys/stat.h>
#include <sys/xattr.h>
#include <unistd.h>

#include "flags.hpp"
#include "orders/orders.hpp"
#include "spelling/spelling.hpp"
#include "table/table.hpp"

namespace ontime::app {
namespace {

namespace fs = std::filesystem;

constexpr const char* suffix = ".yaml";
constexpr const char* folder = "scenarios";

bool is_folder(const fs::path& path) {
  std::error_code ignored;
  return fs::is_directory(path, ignored);
}

bool is_there(const fs::path& path) {
  std::error_code ignored;
  return fs::exists(path, ignored);
}

// A scenario is code: a bare name means the installed scenario, never a file of the current folder.
bool is_path(const std::string& name) {
  return name == "." || name == ".." || name.find('/') != std::string::npos || name.ends_with(suffix);
}

// A mistyped path must not run another scenario: ./demo, ../demo, /demo and demo.yaml are no installed ones.
bool is_only_path(const std::string& name) {
  return name.empty() || name.starts_with('.') || name.starts_with('/') ||
         (name.find('/') == std::string::npos && name.ends_with(suffix));
}

// "paper/test1" is the installed one as well, whatever the current folder has of that name.
fs::path found(const std::string& name) {
  const auto own = is_only_path(name) ? fs::path() : own_scenarios();
  if (!own.empty())
    for (const auto& path : {own / name, own / (name + suffix)})
      if (!name.ends_with(suffix) && is_there(path)) return path;
  if (is_path(name) && is_there(name)) return name;
  if (!own.empty())
    for (const auto& path : {own / name, own.parent_path() / name})
      if (is_there(path)) return path;
  return {};
}

std::string meant(const std::string& name) {
  return spelling::suggestion(fs::path(name).replace_extension(), own_scenario_names()) + ".";
}

std::vector<std::string> files_of(const std::string& name) {
  const auto path = found(name);
  if (name.ends_with(".ontime") && !is_folder(name))
    throw wrong("{} is a results file, not a scenario (*{}). `ontime run` takes it so: {}", name, suffix,
                table::shell_line({"--results", name}));
  if (path.empty())
    throw wrong("{}: no such scenario, file or folder{} `ontime scenarios` lists the installed ones", name,
                is_there(name) ? "; to run the one in this folder: " + table::shell_line({"./" + name}) + "."
                               : meant(name));
  if (!is_folder(path)) return {path.string()};
  std::vector<std::string> files;
  for (const auto& entry : fs::directory_iterator(path))
    if (entry.path().extension() == suffix) files.push_back(entry.path().string());
  std::ranges::sort(files);
  if (files.empty()) throw wrong("{}: this folder has no scenario (*{})", name, suffix);
  return files;
}

// A folder with a sticky bit lets others add files, but not replace those on a `way` through it. A user's
// group with the user's number is the user's alone. Of a file with an access list, the group's bits are those
// of the list.
bool only_we_can_change(const fs::path& path, bool is_way) {
  struct stat of {};
  if (lstat(path.c_str(), &of) != 0 || (!S_ISREG(of.st_mode) && !S_ISDIR(of.st_mode))) return false;
  const char* const caller = std::getenv("SUDO_UID");  // NOLINT(concurrency-mt-unsafe): nothing sets it
  const bool is_ours = of.st_uid == 0 || of.st_uid == geteuid() ||
                       (geteuid() == 0 && caller != nullptr && std::to_string(of.st_uid) == caller);
  const bool is_sticky_way = is_way && (of.st_mode & S_ISVTX) != 0;
  const bool is_group_own = of.st_gid == of.st_uid && of.st_uid != 0 &&
                            getxattr(path.c_str(), "system.posix_acl_access", nullptr, 0) < 0;
  const bool may_others = (of.st_mode & S_IWOTH) != 0 || ((of.st_mode & S_IWGRP) != 0 && !is_group_own);
  return is_ours && (!may_others || is_sticky_way);
}

}  // namespace

fs::path own_scenarios() {
  const auto program = fs::path(orders::this_program()).parent_path();
  // As installed: bin/ontime and share/ontime/scenarios; as built: build/PRESET/bin/ontime and scenarios.
  for (const auto& path :
       {program / ".." / "share" / "ontime" / folder, program / ".." / ".." / ".." / folder})
    if (is_folder(path)) return fs::canonical(path);
  return {};
}

std::vector<std::string> own_scenario_names() {
  std::vector<std::string> names;
  const auto own = own_scenarios();
  if (own.empty()) return names;
  for (const auto& entry : fs::recursive_directory_iterator(own))
    if (entry.path().extension() == suffix)
      names.push_back(entry.path().lexically_relative(own).replace_extension().string());
  std::ranges::sort(names);
  return names;
}

std::vector<std::string> scenario_files(const std::vector<std::string>& names) {
  std::vector<std::string> files;
  for (const auto& name : names)
    for (auto& file : files_of(name)) files.push_back(std::move(file));
  return files;
}

bool is_trusted(const std::string& name) {
  const auto is_in = [&](const std::string& own) { return own == name || own.starts_with(name + "/"); };
  if (std::ranges::any_of(own_scenario_names(), is_in)) return true;
  std::error_code error;
  auto path = fs::absolute(name, error);
  if (error || !is_path(name)) return false;
  if (fs::is_directory(fs::symlink_status(path, error))) {
    for (auto entry = fs::directory_iterator(path, error); !error && entry != fs::directory_iterator();
         entry.increment(error))
      if (entry->path().extension() == suffix && !is_trusted(entry->path().string())) return false;
    if (error) return false;
  } else if (!fs::is_regular_file(path, error)) {
    return false;
  }
  if (!only_we_can_change(path, false)) return false;
  while (path != path.parent_path()) {  // up to the root of all
    path = path.parent_path();
    if (!only_we_can_change(path, true)) return false;
  }
  return true;
}

}  // namespace ontime::app

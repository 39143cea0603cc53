// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <atomic>
#include <cerrno>
#include <filesystem>
#include <random>
#include <system_error>

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "machine/command.hpp"
#include "machine/machine.hpp"
#include "machine/journal_file.hpp"
#include "machine/proc.hpp"
#include "machine/undo.hpp"

namespace ontime::machine {
namespace {

const std::string a_namespace = "namespace";
const std::string a_directory = "directory";

bool exists(const std::string& path) {
  std::error_code ignored;
  return std::filesystem::exists(std::filesystem::symlink_status(path, ignored));
}

std::optional<Owner> living_owner_of(const Change& change) {
  for (const auto& [path, owner] : journal_files()) {
    const auto changes = parse_journal(text_of(path).value_or(""));
    if (alive(owner) && std::find(changes.begin(), changes.end(), change) != changes.end()) return owner;
  }
  return {};
}

Error namespace_exists(const std::string& name, const std::optional<Owner>& owner) {
  if (owner)
    return Error(
        fmt::format("network namespace {} was asked for, but ontime with process id {} is using one of "
                    "that name: wait until it has ended, or end it",
                    name, owner->pid));
  return Error(
      fmt::format("network namespace {} was asked for, but there is one that ontime did not make: if nobody "
                  "needs it, remove it (sudo ip netns delete {})",
                  name, name));
}

Undone undo(const Change& change) {
  if (change.kind == a_namespace && is_plain_name(change.what)) return remove_namespace(change.what);
  if (change.kind == a_directory && change.what.starts_with('/')) return remove_directory(change.what);
  throw Error(
      fmt::format("\"{} {}\" is no change that this version of ontime knows", change.kind, change.what));
}

// What was done and what could not be, a line each. The journal goes when nothing is left in it to undo.
std::vector<std::string> revert_file(const JournalFile& file) {
  std::vector<std::string> lines;
  bool all_undone = true;
  auto changes = parse_journal(text_of(file.path).value_or(""));
  std::reverse(changes.begin(), changes.end());
  for (const auto& change : changes) try {
      // A process killed before it could see that another had been quicker has that one's namespace in its
      // journal.
      const auto other = living_owner_of(change);
      if (other && *other != file.owner) continue;
      if (undo(change) == Undone::done)
        lines.push_back(
            fmt::format("removed {} {}, left by process {}", change.kind, change.what, file.owner.pid));
    } catch (const Error& error) {
      all_undone = false;
      lines.push_back(fmt::format("{} (from {}: remove this file when it has been undone by hand)",
                                  error.what(), file.path));
    }
  if (all_undone) remove_journal(file.path);
  return lines;
}

// Waits until no other process is at work on the same abandoned journal. False if that one has done it all.
bool wait_for_turn(int fd) {
  while (flock(fd, LOCK_EX) != 0)
    if (errno != EINTR) return false;
  struct stat found {};
  return fstat(fd, &found) == 0 && found.st_nlink > 0;
}

std::string random_suffix() {
  std::random_device random;
  return fmt::format("{:08x}{:08x}", random(), random());
}

std::string temporary_folder() {
  std::error_code error;
  auto folder = std::filesystem::temp_directory_path(error).string();
  if (error || folder[0] != '/' || folder.find('\n') != folder.npos)
    throw Error("there is no temporary folder: set TMPDIR to the absolute path of one, or unset it");
  return folder;
}

}  // namespace

Journal::Journal() {
  static std::atomic<unsigned> next = 0;
  path_ = journal_folder() + '/' + name_of(this_process(), next++);
}

Journal::~Journal() { revert(); }

void Journal::add_namespace(const std::string& name) {
  if (!is_plain_name(name)) throw Error(fmt::format("\"{}\" is no name for a network namespace", name));
  const Change change{a_namespace, name};
  if (exists(namespace_path(name))) revert_abandoned();
  if (exists(namespace_path(name))) throw namespace_exists(name, living_owner_of(change));
  const auto length = append(path_, change);
  try {
    ip({"netns", "add", name});
  } catch (const Error&) {
    cut(path_, length);
    // Another process may have been quicker.
    if (const auto owner = living_owner_of(change)) throw namespace_exists(name, owner);
    throw;
  }
}

std::string Journal::add_directory(const std::string& stem) {
  if (!is_plain_name(stem)) throw Error(fmt::format("\"{}\" is no name for a folder", stem));
  auto path = fmt::format("{}/{}-{}", temporary_folder(), stem, random_suffix());
  const auto length = append(path_, {a_directory, path});
  if (mkdir(path.c_str(), 0700) == 0) return path;
  const int error = errno;
  cut(path_, length);
  throw Error(fmt::format("folder {} cannot be made: {}", path, std::generic_category().message(error)));
}

void Journal::revert() noexcept {
  try {
    const auto self = this_process();
    if (owner_of(std::filesystem::path(path_).filename().string()) == self && exists(path_))
      revert_file({path_, self});
  } catch (const std::exception&) {
    return;  // the journal is there still, for revert_abandoned()
  }
}

std::vector<std::string> revert_abandoned() {
  std::vector<std::string> lines;
  for (const auto& file : journal_files()) {
    if (alive(file.owner)) continue;
    const int fd = open(file.path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW);
    if (fd < 0) continue;
    if (wait_for_turn(fd)) {
      auto more = revert_file(file);
      lines.insert(lines.end(), more.begin(), more.end());
    }
    close(fd);
  }
  remove_empty_folder();  // it may have been killed with nothing in it yet
  return lines;
}

}  // namespace ontime::machine

// SPDX-License-Identifier: Apache-2.0
// A folder that is removed with its files.
#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <random>
#include <set>
#include <system_error>
#include <thread>

#include <fcntl.h>
#include <fmt/format.h>
#include <ftw.h>
#include <sys/stat.h>

#include "journal/folder.hpp"
#include "journal/format.hpp"
#include "journal/kinds.hpp"

namespace ontime::journal {
namespace {

namespace fs = std::filesystem;

using namespace std::chrono_literals;

constexpr std::size_t random_digits = 16;
constexpr int patience = 100;  // times 10 ms

Error trouble(const std::string& path, const char* what, int error) {
  return Error(fmt::format("folder {} cannot be {}: {}", path, what, std::generic_category().message(error)));
}

// "/…/ontime-STEM-RANDOM", without "..".
bool accepts(const std::string& path) {
  const auto slash = path.rfind('/');
  if (path.empty() || path[0] != '/' || path.size() > 4000) return false;
  const auto control = [](unsigned char c) { return c < ' ' || c == 0x7f; };
  if (std::any_of(path.begin(), path.end(), control)) return false;
  const auto component = [](const fs::path& part) { return part != "." && part != ".."; };
  const auto parts = fs::path(path);
  if (!std::all_of(parts.begin(), parts.end(), component)) return false;
  const auto name = std::string_view(path).substr(slash + 1);
  const auto hyphen = name.rfind('-');
  const auto is_hex = [](char c) { return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f'); };
  return is_own_name(name) && hyphen > std::string_view(own_prefix).size() &&
         name.size() - hyphen - 1 == random_digits &&
         std::all_of(name.begin() + static_cast<std::ptrdiff_t>(hyphen) + 1, name.end(), is_hex);
}

std::string identity_of(const struct stat& found) { return fmt::format("{}:{}", found.st_dev, found.st_ino); }

Value read(const std::string& path) {
  struct stat found {};
  if (lstat(path.c_str(), &found) == 0) return identity_of(found);
  if (errno == ENOENT || errno == ENOTDIR) return {};
  throw trouble(path, "read", errno);
}

int remove_one(const char* path, const struct stat*, int, FTW* place) {
  return place->level == 0 || std::remove(path) == 0 || errno == ENOENT ? 0 : -1;
}

// The folder is held open, so that no process can replace it meanwhile. Links and mounts that lead out of it
// are not followed.
void empty(const std::string& path, int fd) {
  constexpr int open_folders = 16;
  const auto itself = fmt::format("/proc/self/fd/{}/.", fd);
  constexpr int flags = FTW_DEPTH | FTW_MOUNT | FTW_PHYS;
  // NOLINTNEXTLINE(concurrency-mt-unsafe): it is safe without FTW_CHDIR
  if (nftw(itself.c_str(), remove_one, open_folders, flags) != 0) throw trouble(path, "emptied", errno);
}

void remove(const std::string& path, const Value& present) {
  const auto slash = path.rfind('/');
  const Fd parent(open(path.substr(0, slash + 1).c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  const auto name = path.substr(slash + 1);
  const Fd itself(openat(parent.get(), name.c_str(), O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC));
  struct stat found {};
  if (itself.get() < 0 || fstat(itself.get(), &found) != 0) throw trouble(path, "removed", errno);
  if (found.st_uid != geteuid()) throw trouble(path, "removed", EPERM);
  // The owner was killed before it knew the name, so it cannot have put anything into the folder.
  if (present != to_be_made) {
    if (identity_of(found) != present) throw trouble(path, "removed", ESTALE);
    empty(path, itself.get());
  }
  // Killed processes that write there may need some time to end.
  for (int attempt = 0; unlinkat(parent.get(), name.c_str(), AT_REMOVEDIR) != 0; ++attempt) {
    if (errno != ENOTEMPTY || present == to_be_made || attempt == patience)
      throw trouble(path, "removed", errno);
    std::this_thread::sleep_for(10ms);
    empty(path, itself.get());
  }
}

void write(const std::string& path, const Value& value, const Value& present) {
  if (!value) return remove(path, present);
  if (mkdir(path.c_str(), 0700) != 0) throw trouble(path, "made", errno);
}

std::string temporary_folder() {
  std::error_code error;
  const auto stated = fs::temp_directory_path(error);
  // Without links: another program may let one lead elsewhere before the folder is removed.
  auto folder = stated.is_absolute() ? fs::canonical(stated, error).string() : "";
  if (error || folder.empty())
    throw Error("no temporary folder. Fix: set TMPDIR to the absolute path of a folder, or unset it");
  return folder;
}

// Includes the journals of living processes.
std::set<std::string> named_by_journals() {
  std::set<std::string> named;
  const auto folder = Folder::find();
  if (!folder) return named;
  for (const auto& name : folder->journals()) {
    const auto journal = folder->open(name);
    if (!journal.not_used.empty()) continue;
    for (const auto& entry : parse(text_of(journal.fd.get())).entries)
      if (entry.kind == directory_kind.name) named.insert(entry.what);
  }
  return named;
}

}  // namespace

const Kind directory_kind = {"directory",      Scope::mount_namespace, accepts, read, write,
                             /*on_disk=*/true, /*needs_root=*/false};

std::string add_directory(Journal& journal, const std::string& stem) {
  if (!is_plain_name(stem))
    throw Error(
        fmt::format("folder name \"{}\": only lower case letters, digits and hyphens are supported", stem));
  std::random_device random;
  auto path = fmt::format("{}/{}{}-{:08x}{:08x}", temporary_folder(), own_prefix, stem, random(), random());
  journal.change(directory_kind, path, to_be_made);
  return path;
}

std::time_t time_of_boot() {
  std::ifstream file("/proc/stat");
  std::time_t seconds = 0;
  for (std::string word; file >> word;)
    if (word == "btime" && file >> seconds) return seconds;
  return 0;
}

std::vector<std::string> forgotten_directories(std::time_t before) {
  const auto named = named_by_journals();
  std::vector<std::string> found;
  std::error_code none;
  for (const auto& entry : fs::directory_iterator(temporary_folder(), none)) {
    struct stat itself {};
    const auto path = entry.path().string();
    if (accepts(path) && lstat(path.c_str(), &itself) == 0 && S_ISDIR(itself.st_mode) &&
        itself.st_uid == geteuid() && itself.st_mtime < before && !named.contains(path))
      found.push_back(path);
  }
  return found;
}

std::vector<std::string> remove_directory(Journal& journal, const std::string& path) {
  return journal.take_back(directory_kind, path);
}

}  // namespace ontime::journal

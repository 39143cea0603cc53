// SPDX-License-Identifier: Apache-2.0
#include "listen/processes.hpp"

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>

#include <fcntl.h>
#include <fmt/format.h>
#include <linux/magic.h>
#include <sys/stat.h>
#include <sys/vfs.h>

#include "number.hpp"

namespace ontime::listen {
namespace {

using namespace std::chrono_literals;

constexpr auto longest_pause = 10s;
constexpr std::size_t most_files = 64;  // of a process

std::optional<Middleware> middleware_of(std::string_view library) {
  if (library.starts_with("librmw_") && library.find("_cpp.so") != library.npos) return Middleware::rmw;
  if (library.starts_with("libddsc.so") || library.starts_with("libddscdebian.so"))
    return Middleware::cyclonedds;
  if (library.starts_with("libfastrtps.so") || library.starts_with("libfastdds.so"))
    return Middleware::fastdds;
  if (library.starts_with("librcl.so")) return Middleware::rcl;
  return {};
}

using Opened = std::map<std::pair<std::uint64_t, std::uint64_t>,
                        std::shared_ptr<const process::Fd>>;  // by device and inode

// Also sets what /proc/PID/maps lacks, or states differently from stat() (Btrfs). A file that many processes
// map is opened once. False: it is gone, or not a regular file.
bool open_file(Mapping& mapping, Opened& all) {
  auto opened = std::make_shared<const process::Fd>(open(mapping.path.c_str(), O_PATH | O_CLOEXEC));
  const int fd = opened->get();
  struct stat file {};
  struct statfs system {};
  if (fd < 0 || fstat(fd, &file) != 0 || !S_ISREG(file.st_mode) || fstatfs(fd, &system) != 0) return false;
  mapping.file = {file.st_dev, file.st_ino};
  mapping.is_on_overlay = system.f_type == OVERLAYFS_SUPER_MAGIC;
  mapping.opened = all.try_emplace(mapping.file, std::move(opened)).first->second;
  mapping.path = fmt::format("/proc/self/fd/{}", mapping.opened->get());
  return true;
}

// 0: the process is gone.
std::uint64_t start_of(std::uint32_t process) {
  const auto stat = process::parse_stat(process::text_of(fmt::format("/proc/{}/stat", process)).value_or(""));
  return stat ? stat->start_ticks : 0;
}

}  // namespace

std::string process_name(std::uint32_t process) {
  return process::word(process::text_of(fmt::format("/proc/{}/comm", process))).value_or("");
}

std::optional<Mapping> mapping_of(const std::string& line, std::uint32_t process) {
  unsigned long long begin = 0, end = 0, inode = 0;
  unsigned major = 0, minor = 0;
  char access[5] = {};
  int path_at = 0;
  // NOLINTNEXTLINE(cert-err34-c): what does not parse is no mapping
  if (std::sscanf(line.c_str(), "%llx-%llx %4s %*x %x:%x %llu %n", &begin, &end, access, &major, &minor,
                  &inode, &path_at) != 6 ||
      path_at == 0 || static_cast<std::size_t>(path_at) >= line.size())
    return {};
  const auto path = line.substr(static_cast<std::size_t>(path_at));
  auto name = path.substr(path.rfind('/') + 1);
  if (const auto deleted = name.find(" (deleted)"); deleted != name.npos) name.resize(deleted);
  const auto middleware = middleware_of(name);
  if (!middleware || access[2] != 'x') return {};
  return Mapping{.middleware = *middleware,
                 .name = name,
                 .path = fmt::format("/proc/{}/map_files/{:x}-{:x}", process, begin, end),
                 .file = {std::uint64_t{major} << 32U | minor, inode}};
}

void Processes::look_again() {
  for (auto& [id, known] : known_) known = {.started = known.started, .first = {}, .again = {}, .files = {}};
}

Processes::Change Processes::look() {
  Change change;
  const auto now = std::chrono::steady_clock::now();
  std::set<std::uint32_t> present;
  Opened opened;
  std::error_code error;
  for (std::filesystem::directory_iterator entry("/proc", error), end; entry != end; entry.increment(error)) {
    const auto number = number_in<std::uint32_t>(entry->path().filename().string());
    if (!number) continue;
    const auto id = *number;
    present.insert(id);  // if it ended since, it is gone at the next look
    const auto started = start_of(id);
    if (started == 0) continue;
    auto& known = known_[id];
    if (known.started != started) {
      if (known.started != 0) change.gone.push_back(id);
      known = {.started = started, .first = {}, .again = {}, .files = {}};
    }
    if (now < known.again) continue;
    if (known.first == std::chrono::steady_clock::time_point()) known.first = now;
    // A process loads most of its libraries soon after it starts.
    known.again = now + std::min<std::chrono::steady_clock::duration>((now - known.first) / 4, longest_pause);
    std::ifstream maps(fmt::format("/proc/{}/maps", id));
    Process process{.id = id, .name = process_name(id), .libraries = {}};
    for (std::string line; std::getline(maps, line);) {
      auto mapping = mapping_of(line, id);
      if (!mapping || known.files.size() == most_files || !open_file(*mapping, opened)) continue;
      if (!known.files.insert(mapping->use()).second) continue;
      process.libraries.push_back(*mapping);
    }
    if (!process.libraries.empty()) change.came.push_back(std::move(process));
  }
  if (error) return change;  // it is unknown which processes ended
  std::erase_if(known_, [&](const auto& one) {
    if (present.contains(one.first)) return false;
    change.gone.push_back(one.first);
    return true;
  });
  return change;
}

}  // namespace ontime::listen

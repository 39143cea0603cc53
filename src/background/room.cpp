// SPDX-License-Identifier: Apache-2.0
// Load must fit the machine: with too much of it a run measures swapping and the OOM killer.
#include <algorithm>
#include <cerrno>
#include <fstream>
#include <map>
#include <string>
#include <system_error>

#include <fmt/format.h>
#include <linux/magic.h>
#include <sys/statfs.h>

#include "background/background.hpp"

namespace ontime::background {
namespace {

constexpr std::uint64_t mebibyte = 1U << 20U;
constexpr std::uint64_t usual_vm_bytes = 256 * mebibyte, usual_hdd_bytes = 1024 * mebibyte;
constexpr std::uint64_t largest_reserve = 1024 * mebibyte;

// Of a whole: what the machine needs to go on as usual.
std::uint64_t reserve_of(std::uint64_t whole) { return std::min(whole / 10, largest_reserve); }

std::uint64_t without(std::uint64_t bytes, std::uint64_t taken) { return bytes - std::min(bytes, taken); }

std::string in_words(std::uint64_t bytes) {
  return bytes % mebibyte == 0 || bytes > 10 * mebibyte ? fmt::format("{} MiB", bytes / mebibyte)
                                                        : fmt::format("{} bytes", bytes);
}

// The size of each worker of a kind: the stated size, which must fit; else the usual size, or less where that
// does not fit.
std::uint64_t size_of_each(const char* kind, int workers, std::uint64_t stated, std::uint64_t usual,
                           std::uint64_t room, const char* of_what, std::string& scaled) {
  if (workers <= 0) return stated;
  const auto wanted = stated > 0 ? stated : usual;
  const auto most = room / static_cast<std::uint64_t>(workers);
  if (wanted <= most) return wanted;
  if (stated > 0 || most < mebibyte)
    throw Error(
        fmt::format("load: {0} {1} workers of {2} each need more {3} than available: {4}. Fix: fewer "
                    "workers, or a smaller {1}-bytes",
                    workers, kind, in_words(wanted), of_what, in_words(room)));
  const auto fitting = most / mebibyte * mebibyte;
  scaled += fmt::format("{}each of {} {} workers has {} instead of {}: not enough {}",
                        scaled.empty() ? "load: " : "; ", workers, kind, in_words(fitting), in_words(usual),
                        of_what);
  return fitting;
}

}  // namespace

Room room_for(const std::string& directory, const std::optional<machine::GroupMemory>& group) {
  std::map<std::string, std::uint64_t> kilobytes;
  std::ifstream file("/proc/meminfo");
  std::string name, unit;
  for (std::uint64_t number = 0; file >> name >> number; std::getline(file, unit)) kilobytes[name] = number;
  struct statfs disk {};
  if (statfs(directory.c_str(), &disk) != 0)
    throw Error(fmt::format("load: cannot read the free space of {}: {}", directory,
                            std::generic_category().message(errno)));
  const auto block = static_cast<std::uint64_t>(disk.f_bsize);
  auto memory = without(kilobytes["MemAvailable:"] * 1024, reserve_of(kilobytes["MemTotal:"] * 1024));
  if (group) memory = std::min(memory, without(group->left_bytes(), reserve_of(group->limit_bytes)));
  return {memory, without(disk.f_bavail * block, reserve_of(disk.f_blocks * block)),
          disk.f_type == TMPFS_MAGIC};
}

Fitted fit(const Workers& stated, Room& room) {
  Fitted fitted{stated, ""};
  auto& workers = fitted.workers;
  workers.vm_bytes = size_of_each("vm", workers.vm, workers.vm_bytes, usual_vm_bytes, room.memory_bytes,
                                  "memory", fitted.scaled);
  room.memory_bytes -= workers.vm_bytes * static_cast<std::uint64_t>(std::max(workers.vm, 0));
  const auto disk = room.disk_is_memory ? std::min(room.disk_bytes, room.memory_bytes) : room.disk_bytes;
  workers.hdd_bytes =
      size_of_each("hdd", workers.hdd, workers.hdd_bytes, usual_hdd_bytes, disk,
                   room.disk_is_memory ? "memory (the temporary folder is a tmpfs)" : "disk", fitted.scaled);
  const auto written = workers.hdd_bytes * static_cast<std::uint64_t>(std::max(workers.hdd, 0));
  if (written > 0 && room.disk_is_memory)
    fitted.scaled += fmt::format(
        "{}hdd workers write to memory, not to a disk: the temporary folder is a tmpfs. Fix: set TMPDIR to a "
        "folder on a disk, such as /var/tmp",
        fitted.scaled.empty() ? "load: " : "; ");
  room.disk_bytes -= written;
  if (room.disk_is_memory) room.memory_bytes -= written;
  return fitted;
}

}  // namespace ontime::background

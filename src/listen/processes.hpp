// SPDX-License-Identifier: Apache-2.0
// The processes of this machine that map a middleware's library.
#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "listen/library.hpp"
#include "listen/listen.hpp"
#include "process/process.hpp"

namespace ontime::listen {

// `rcl` sends no messages: its probe shows when a timer's callback begins.
enum class Middleware : std::uint8_t { rmw, cyclonedds, fastdds, rcl };

struct Mapping {
  Middleware middleware = Middleware::rmw;
  std::string name;  // of the library, "librmw_cyclonedds_cpp.so"
  std::string path;  // opens this very file, also in another mount namespace, and after an upgrade removed it
  // Keeps `path` valid: a process may map another file, under any name, at any time.
  std::shared_ptr<const process::Fd> opened{};
  std::pair<std::uint64_t, std::uint64_t> file;  // device and inode
  // Another user may map a file under the name of another middleware.
  using Use = std::pair<Middleware, std::pair<std::uint64_t, std::uint64_t>>;
  Use use() const { return {middleware, file}; }
  bool is_on_overlay = false;  // containers of one image share the file, with different inodes
};

// From /proc/PID/comm; empty: the process ended.
std::string process_name(std::uint32_t process);

struct Process {
  std::uint32_t id = 0;
  std::string name;
  std::vector<Mapping> libraries;
};

// Reads /proc/PID/maps of processes that are new, and of the others from time to time: they may load a
// library late.
class Processes {
 public:
  struct Change {
    std::vector<Process> came;  // each library of a process once
    std::vector<std::uint32_t> gone;
  };
  Change look();
  // Reports all processes again as new; the ended ones as gone.
  void look_again();

 private:
  struct Known {
    std::uint64_t started = 0;  // in ticks after boot: another process may get the same number
    std::chrono::steady_clock::time_point first, again;  // when its libraries were looked at
    std::set<Mapping::Use> files;
  };
  std::map<std::uint32_t, Known> known_;
};

// The middleware library of a line of /proc/PID/maps, not opened yet; empty: another mapping.
std::optional<Mapping> mapping_of(const std::string& line, std::uint32_t process);

}  // namespace ontime::listen

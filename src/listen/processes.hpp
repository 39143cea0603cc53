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

namespace ontime::listen {

// `rcl` sends no messages: it tells when a timer's callback begins.
enum class Middleware : std::uint8_t { rmw, cyclonedds, fastdds, rcl };

struct Mapping {
  Middleware middleware = Middleware::rmw;
  std::string name;  // of the library, "librmw_cyclonedds_cpp.so"
  std::string path;  // opens this very file, also in another mount namespace, and after an upgrade removed it
  // Keeps `path`: a process may map another file at any time, and name it as it likes.
  std::shared_ptr<const OpenFile> opened{};
  std::pair<std::uint64_t, std::uint64_t> file;  // device and inode
  // What it is probed as: another user may map a file by another middleware's name.
  using Use = std::pair<Middleware, std::pair<std::uint64_t, std::uint64_t>>;
  Use use() const { return {middleware, file}; }
  bool is_on_overlay = false;  // containers of one image have one such file, by different numbers
};

// As the kernel has it; empty where the process has ended.
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
  // As if all processes were new; those that end meanwhile are told of.
  void look_again();

 private:
  struct Known {
    std::uint64_t started = 0;  // in ticks after boot: another process may get the same number
    std::chrono::steady_clock::time_point first, again;  // when its libraries were looked at
    std::set<Mapping::Use> files;
  };
  std::map<std::uint32_t, Known> known_;
};

// What a line of /proc/PID/maps says of a middleware's library, which is not opened yet; empty: it is of
// something else.
std::optional<Mapping> mapping_of(const std::string& line, std::uint32_t process);

}  // namespace ontime::listen

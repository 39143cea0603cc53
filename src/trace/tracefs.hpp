// SPDX-License-Identifier: Apache-2.0
// The kernel's tracefs, by a mount of our own that no other process sees: it need not be mounted anywhere,
// and nothing is left mounted. There is one tracefs a kernel, for every mount.
#pragma once

#include <string>

#include <sys/stat.h>

#include "process/process.hpp"

namespace ontime::trace {

class Tracefs {
 public:
  Tracefs();  // throws Error
  // Paths are within it.
  bool has(const std::string& path) const;
  bool look(const std::string& path, struct stat&) const;  // false: it does not exist
  std::string read(const std::string& path) const;         // throws Error
  void write(const std::string& path, const std::string& text) const;
  process::Fd open(const std::string& path, int flags) const;
  void make(const std::string& folder) const;
  void remove(const std::string& folder) const;

 private:
  process::Fd root_;
};

}  // namespace ontime::trace

// SPDX-License-Identifier: Apache-2.0
// A worker's process, and the pipe to it.
#pragma once

#include <string>
#include <vector>

#include <sys/types.h>

#include "orders/frames.hpp"

namespace ontime::orders {

class Process {
 public:
  // In a process group of its own, so that a terminal's Ctrl-C reaches the coordinator alone. Throws Error.
  Process(const std::string& name, const std::vector<std::string>& command);
  ~Process();  // breaks the pipe and waits; kills it after a while, or at once if it was given up
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  Frames& frames() { return frames_; }
  void give_up() { given_up_ = true; }
  // How it ended, for people; waits a little for it to do so. Throws Error, always.
  [[noreturn]] void gone() const;

 private:
  struct Spawned {
    pid_t pid;
    int in, out;  // ours: we write to `in`, read from `out`
  };
  Process(std::string name, std::string command, Spawned);
  static Spawned spawn(const std::string& name, const std::vector<std::string>& command);
  std::string name_, command_;
  Spawned spawned_;
  Frames frames_;
  bool given_up_ = false;
};

}  // namespace ontime::orders

// SPDX-License-Identifier: Apache-2.0
// A worker's process, and the pipe to it.
#pragma once

#include <csignal>
#include <string>
#include <vector>

#include <sys/types.h>

#include "orders/orders.hpp"
#include "process/process.hpp"

namespace ontime::orders {

class Process {
 public:
  // In a process group of its own, so that a terminal's Ctrl-C reaches the coordinator alone. Throws Error.
  Process(std::string name, const std::vector<std::string>& command, Between = {});
  ~Process();  // breaks the pipe and waits; kills its group after a while, or at once if it was given up
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  Frames& frames() { return frames_; }
  void give_up() { given_up_ = true; }
  void break_pipe();                 // of orders; its output is still read
  void let_go() { let_go_ = true; }  // it may outlive this
  // How it ended, for people; waits a little for it to do so. Throws Error, always.
  [[noreturn]] void gone() const;
  // Its first bytes are not a frame. Throws Error, always.
  [[noreturn]] void foreign(const std::string& what) const;

 private:
  struct Spawned {
    pid_t pid;
    process::Fd in, out;  // ours: we write to `in`, read from `out`
  };
  static Spawned spawn(const std::string& name, const std::vector<std::string>& command);
  // Waits a little for its end; si_pid 0: it still runs. Throws Error if Between::reason knows why.
  siginfo_t end_without_reason() const;
  std::string name_, command_;
  Between between_;
  Spawned spawned_;
  Frames frames_;
  bool given_up_ = false, let_go_ = false;
};

}  // namespace ontime::orders

// SPDX-License-Identifier: Apache-2.0
// A child process that cannot outlive the thread that started it; and what /proc says of processes.
#pragma once

#include <chrono>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <sys/types.h>

#include "process/process.hpp"

namespace ontime::background {

using process::Started;

// `ordinary` whatever the caller is: SCHED_OTHER, niceness 0 (without root the caller's, if that is higher),
// any CPU.
enum class Scheduling { ordinary, callers };

// Runs a program, found through PATH, with no signal blocked or ignored, as leader of its process group. It
// reads nothing and writes both its outputs to `output`. It is killed when the calling thread ends, however
// that ends. Where the kernel permits (CAP_SYS_ADMIN, or user namespaces) it is the first process of a PID
// namespace, and all its descendants are killed with it. Into each file of `groups` it writes a 0 first: so
// it is in that control group, and so are all its descendants. The pid is -1 if it could not be started.
Started start(const std::vector<std::string>& command, int output,
              const std::vector<std::string>& groups = {}, Scheduling = Scheduling::ordinary);

// The user that load and traffic run as: they must not have root's reserves or rights.
inline constexpr uid_t nobody = 65534;

// Words before a command, by which root starts it as the user nobody, without any privilege, and still killed
// with the thread that started it. None for a caller that is not root, and where this user is not mapped.
// Throws Error for a root that lacks a capability for that.
// `with_folder`: the command gets a folder of its own.
std::vector<std::string> as_nobody(bool with_folder = false);

// Whether a command ended because env, setpriv, chrt or a shell did not find its program, in any language.
bool is_of_missing_program(int exit_code, const std::string& output);

// Owns such a process. The destructor ends it and its group, and waits; only some seconds if the kernel does
// not let one go: that one is killed, and ends later.
class Child {
 public:
  explicit Child(pid_t pid) : pid_(pid) {}
  ~Child();
  // Asks it and its group to end, and kills them some seconds after the first call. Returns whether nothing
  // of them is left; returns at once.
  bool end();
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;
  pid_t pid() const { return pid_; }
  bool ended() const;     // by itself
  int exit_code() const;  // with which it ended; -1: it runs, or was killed

 private:
  pid_t pid_;  // -1: nothing of it is left
  std::optional<std::chrono::steady_clock::time_point> asked_;
};

// Runs a program until it ends, at most for `limit`, and returns its output. Throws Error with that output if
// it fails, or with the package to install if it is missing.
std::string output_of(const std::vector<std::string>& command, const std::string& package,
                      std::chrono::nanoseconds limit = std::chrono::seconds(10));

// Polls the condition; false if the limit passes first.
bool wait_until(const std::function<bool()>& condition, std::chrono::nanoseconds limit);

// All that /proc shows.
std::vector<process::Stat> processes();

}  // namespace ontime::background

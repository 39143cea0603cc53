// SPDX-License-Identifier: Apache-2.0
// What /proc says of processes.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include <sys/types.h>

namespace ontime::background {

struct Process {
  pid_t pid;
  std::string name;
  char state;
  pid_t parent;
  pid_t group;
  bool ended() const { return state == 'Z' || state == 'X'; }  // but not yet waited for
};

// Of the text of /proc/PID/stat; nothing if it is no such text.
std::optional<Process> parse_stat(const std::string& text);
std::vector<Process> processes();

}  // namespace ontime::background

// SPDX-License-Identifier: Apache-2.0
// Child processes, and files in memory for what they read and write.
#pragma once

#include <array>
#include <string>
#include <vector>

#include <sys/types.h>

namespace ontime::process {

struct Started {
  pid_t pid;  // only without an error
  int error;  // an errno if it could not be started; ENOENT: no such program
};

// With its own process group, a terminal's Ctrl-C reaches the caller alone.
enum class Group { own, callers };

// Starts a program, found through PATH, without a shell. `streams`: its standard input, output and error; 0,
// 1 and 2 are the caller's own.
Started start(std::vector<std::string> command, const std::array<int, 3>& streams, Group = Group::own);

// Whether it has ended. Its id stays taken until wait_for().
bool has_ended(pid_t);
int wait_for(pid_t);  // the status of waitpid()

// A file in memory, which is not limited as a pipe is: a child that writes into it never blocks.
class Memory {
 public:
  Memory();
  ~Memory();
  Memory(const Memory&) = delete;
  Memory& operator=(const Memory&) = delete;
  int fd() const { return fd_; }
  bool hold(const std::string&);  // to be read from its begin; false: there is not enough memory
  // At most so many bytes of what was written: a child may go on writing.
  std::string text(off_t most = 1 << 20) const;

 private:
  int fd_;
};

}  // namespace ontime::process

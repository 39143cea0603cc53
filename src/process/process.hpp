// SPDX-License-Identifier: Apache-2.0
// Child processes, files in memory for what they read and write, and what the kernel says of any process. And
// the owner of a file descriptor.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <sys/types.h>
#include <unistd.h>

namespace ontime::process {

// Owns a file descriptor, and closes it. Below 0: none.
class Fd {
 public:
  explicit Fd(int fd = -1) : fd_(fd) {}
  Fd(Fd&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  Fd& operator=(Fd&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  ~Fd() {
    if (fd_ >= 0) close(fd_);
  }
  Fd(const Fd&) = delete;
  Fd& operator=(const Fd&) = delete;
  int get() const { return fd_; }

 private:
  int fd_;
};

struct Started {
  pid_t pid;  // only without an error
  int error;  // an errno if it could not be started; ENOENT: no such program
};

// With its own process group, a terminal's Ctrl-C reaches the caller alone.
enum class Group { own, callers };

// Starts a program, found through PATH, without a shell. `streams`: its standard input, output and error; 0,
// 1 and 2 are the caller's own.
Started start(std::vector<std::string> command, const std::array<int, 3>& streams, Group = Group::own);

// Before a child is started in another way. The program that started this one may have ignored SIGCHLD: then
// the kernel forgets a child when it ends, and gives its id to another process.
void heed_ends_of_children();

std::vector<std::string> command_line();  // of this process; empty without /proc

// Whether it has ended. Its id stays taken until wait_for().
bool has_ended(pid_t);
int wait_for(pid_t);  // the status of waitpid()

// Of a file such as those of /proc and /sys. Nothing if it cannot be read; an empty file is empty text.
std::optional<std::string> text_of(const std::string& path);
// Without white space at its ends; nothing if nothing is left.
std::optional<std::string> word(const std::optional<std::string>& text);
std::optional<std::int64_t> number(const std::optional<std::string>& text);
// The value behind "key :" in a file such as /proc/cpuinfo or /proc/meminfo; the first if there are several.
std::optional<std::string> field(const std::string& text, const std::string& key);

// A process, or a thread of one, in a file /proc/…/stat: proc(5).
struct Stat {
  pid_t pid, parent, group;  // pid: of a thread its own id
  std::string name;
  char state;
  unsigned long flags;  // of <linux/sched.h>, PF_…
  std::uint64_t minor_faults, major_faults;
  std::uint64_t start_ticks;                                       // since boot
  int priority, policy;                                            // as sched_setscheduler(2) counts them
  bool has_ended() const { return state == 'Z' || state == 'X'; }  // but not yet waited for
  bool is_of_kernel() const { return (flags & 0x0020'0000) != 0; }
};
// Of the text of such a file; nothing if that is cut, or another one's.
std::optional<Stat> parse_stat(const std::string& text);

// A file in memory, which is not limited as a pipe is: a child that writes into it never blocks.
class Memory {
 public:
  Memory();
  int fd() const { return fd_.get(); }
  bool hold(const std::string&);  // to be read from its begin; false: there is not enough memory
  // At most so many bytes of what was written: a child may go on writing.
  std::string text(off_t most = 1 << 20) const;

 private:
  Fd fd_;
};

}  // namespace ontime::process

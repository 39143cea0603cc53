// SPDX-License-Identifier: Apache-2.0
#include "machine/command.hpp"

#include <algorithm>
#include <cerrno>
#include <system_error>
#include <thread>

#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <spawn.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include "machine/machine.hpp"
#include "machine/proc.hpp"

namespace ontime::machine {
namespace {

// What a child writes, kept in memory, so that it never blocks.
class Output {
 public:
  Output() : fd_(memfd_create("command output", MFD_CLOEXEC)) {}
  ~Output() { close(fd_); }
  Output(const Output&) = delete;
  Output& operator=(const Output&) = delete;
  int fd() const { return fd_; }
  std::string text() const {
    std::string all(static_cast<std::size_t>(std::clamp<off_t>(lseek(fd_, 0, SEEK_END), 0, most)), '\0');
    const auto bytes = pread(fd_, all.data(), all.size(), 0);
    all.resize(static_cast<std::size_t>(std::max<ssize_t>(bytes, 0)));
    return all;
  }

 private:
  static constexpr off_t most = 1 << 20;  // of a child that goes on writing
  int fd_;
};

struct Started {
  pid_t pid;
  int error;  // an errno if it could not be; ENOENT: no such program
};

Started spawn(std::vector<std::string> command, int output) {
  std::vector<char*> words;
  words.reserve(command.size() + 1);
  for (auto& word : command) words.push_back(word.data());
  words.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_adddup2(&actions, output, STDOUT_FILENO);
  posix_spawn_file_actions_adddup2(&actions, output, STDERR_FILENO);
  // In a process group of its own: Ctrl-C is for us, and does not stop a change half-way.
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP);
  posix_spawnattr_setpgroup(&attributes, 0);
  pid_t pid = -1;
  const int error = posix_spawnp(&pid, words[0], &actions, &attributes, words.data(), environ);
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&actions);
  return {pid, error};
}

int wait_for(pid_t pid) {
  int status = -1;
  while (waitpid(pid, &status, 0) < 0 && errno == EINTR) continue;
  return status;
}

bool ended(pid_t pid) {
  siginfo_t info{};
  return waitid(P_PID, static_cast<id_t>(pid), &info, WEXITED | WNOHANG | WNOWAIT) != 0 || info.si_pid == pid;
}

std::string answer_of_iproute2(std::string program, const std::vector<std::string>& arguments) {
  std::vector<std::string> command = {std::move(program)};
  command.insert(command.end(), arguments.begin(), arguments.end());
  const Output output;
  const auto asked = fmt::format("{}", fmt::join(command, " "));
  const auto started = spawn(command, output.fd());
  if (started.error == ENOENT)
    throw Error(fmt::format("{}: no program `{}`. Fix: sudo apt install iproute2", asked, command.front()));
  if (started.error != 0)
    throw Error(fmt::format("{}: {}", asked, std::generic_category().message(started.error)));
  if (wait_for(started.pid) != 0)
    throw Error(fmt::format("{} failed: {}", asked, word(output.text()).value_or("no error message")));
  return output.text();
}

}  // namespace

std::string ip(const std::vector<std::string>& arguments) { return answer_of_iproute2("ip", arguments); }
std::string tc(const std::vector<std::string>& arguments) { return answer_of_iproute2("tc", arguments); }

std::optional<std::string> answer_of(const std::vector<std::string>& command,
                                     std::chrono::nanoseconds limit) {
  const Output output;
  const auto started = spawn(command, output.fd());
  if (started.error != 0) return {};
  const auto end = std::chrono::steady_clock::now() + limit;
  while (!ended(started.pid)) {
    if (std::chrono::steady_clock::now() > end) kill(-started.pid, SIGKILL);
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  if (wait_for(started.pid) != 0) return {};
  return output.text();
}

}  // namespace ontime::machine

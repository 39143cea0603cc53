// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <system_error>
#include <thread>

#include <fmt/format.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include "background/background.hpp"
#include "background/child.hpp"
#include "background/process.hpp"

namespace ontime::background {
namespace {

using namespace std::chrono_literals;

constexpr auto time_to_start = 20s;  // 32 workers on one busy core need a second or two
constexpr auto time_to_end = 3s;

// What a child writes, kept in memory: nobody need read while it writes.
class Output {
 public:
  Output() : fd_(memfd_create("stress-ng output", MFD_CLOEXEC)) {}
  ~Output() { close(fd_); }
  Output(const Output&) = delete;
  Output& operator=(const Output&) = delete;
  int fd() const { return fd_; }
  std::string text() const {
    std::array<char, 4096> head;
    const auto bytes = pread(fd_, head.data(), head.size(), 0);
    return {head.data(), static_cast<std::size_t>(std::max<ssize_t>(bytes, 0))};
  }

 private:
  int fd_;
};

void add(std::vector<std::string>& command, const char* kind, int workers, std::uint64_t bytes = 0) {
  if (workers < 0)
    throw Error(fmt::format("{} workers of stress-ng --{} make no load: 0 or more", workers, kind));
  if (workers == 0) return;
  command.insert(command.end(), {fmt::format("--{}", kind), std::to_string(workers)});
  if (bytes > 0) command.insert(command.end(), {fmt::format("--{}-bytes", kind), std::to_string(bytes)});
}

std::vector<std::string> command_for(const Workers& workers, const std::string& directory) {
  constexpr const char* for_ever = "0";  // without it, stress-ng ends after a day
  std::vector<std::string> command = {"stress-ng", "--temp-path", directory, "--timeout", for_ever};
  add(command, "cpu", workers.cpu);
  add(command, "vm", workers.vm, workers.vm_bytes);
  add(command, "io", workers.io);
  add(command, "hdd", workers.hdd, workers.hdd_bytes);
  return command;
}

long children_of(pid_t pid) {
  const auto all = processes();
  return std::count_if(all.begin(), all.end(),
                       [pid](const Process& process) { return process.parent == pid && !process.ended(); });
}

// Leaves it to be waited for: its id, and its group's, must not become another's meanwhile.
bool ended(pid_t pid) {
  siginfo_t info{};
  return waitid(P_PID, static_cast<id_t>(pid), &info, WEXITED | WNOHANG | WNOWAIT) != 0 || info.si_pid == pid;
}

template <typename Condition>
bool wait_until(Condition condition, std::chrono::nanoseconds limit) {
  for (const auto end = std::chrono::steady_clock::now() + limit; !condition();
       std::this_thread::sleep_for(5ms))
    if (std::chrono::steady_clock::now() > end) return false;
  return true;
}

// A leader of a PID namespace has ended only when all its descendants have; elsewhere they may come later.
bool group_gone(pid_t group) {
  const auto all = processes();
  return std::none_of(all.begin(), all.end(), [group](const Process& process) {
    return process.group == group && process.pid != group && !process.ended();
  });
}

void end(pid_t pid) {
  kill(-pid, SIGTERM);
  wait_until([pid] { return ended(pid); }, time_to_end);
  kill(-pid, SIGKILL);
  while (!ended(pid) || !group_gone(pid)) std::this_thread::sleep_for(5ms);
  waitpid(pid, nullptr, 0);
}

Error not_started(int error) {
  if (error == ENOENT)
    return Error("load was asked for, but there is no stress-ng: install it (sudo apt install stress-ng)");
  return Error(fmt::format("stress-ng cannot be started: {}", std::generic_category().message(error)));
}

class Stress final : public Background {
 public:
  explicit Stress(pid_t pid) : pid_(pid) {}
  ~Stress() override { end(pid_); }
  Stress(const Stress&) = delete;
  Stress& operator=(const Stress&) = delete;
  bool running() override { return !ended(pid_); }

 private:
  pid_t pid_;
};

}  // namespace

std::unique_ptr<Background> stress(const Workers& workers, const std::string& directory) {
  const auto command = command_for(workers, directory);
  const long wanted = long{workers.cpu} + workers.vm + workers.io + workers.hdd;
  if (wanted == 0)
    throw Error("load without a worker was asked for: name a number of cpu, vm, io or hdd workers");
  const Output output;
  const auto started = start(command, output.fd());
  if (started.pid < 0) throw not_started(started.error);
  const pid_t pid = started.pid;
  long running = 0;
  wait_until([&] { return ended(pid) || (running = children_of(pid)) >= wanted; }, time_to_start);
  const bool has_ended = ended(pid);
  if (!has_ended && running >= wanted) return std::make_unique<Stress>(pid);
  end(pid);
  const auto what = has_ended ? "ended at once" : fmt::format("runs only {} of {} workers", running, wanted);
  throw Error(fmt::format("{} {}; it said:\n{}", fmt::join(command, " "), what, output.text()));
}

}  // namespace ontime::background

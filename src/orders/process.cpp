// SPDX-License-Identifier: Apache-2.0
#include "orders/process.hpp"

#include <array>
#include <cerrno>
#include <filesystem>
#include <system_error>
#include <thread>
#include <utility>

#include <fcntl.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sys/wait.h>
#include <unistd.h>

namespace ontime::orders {
namespace {

using namespace std::chrono_literals;

// Large, so that workers do not block when the coordinator is delayed for a moment.
constexpr int pipe_bytes = 1 << 20;
constexpr auto patience_ahead = 60s;  // a slow link; before it a slow ssh

std::string errno_text(int code) { return words_of(std::system_error(code, std::generic_category())); }

struct Pipe {
  process::Fd out, in;
};

Pipe made_pipe() {
  std::array<int, 2> ends;
  if (pipe2(ends.data(), O_CLOEXEC) != 0) throw Error(3, "cannot create a pipe: " + errno_text(errno));
  fcntl(ends[1], F_SETPIPE_SZ, pipe_bytes);  // as much of it as an ordinary user may have
  return {process::Fd(ends[0]), process::Fd(ends[1])};
}

}  // namespace

std::string words_of(const std::exception& error) {
  const auto* const of_system = dynamic_cast<const std::system_error*>(&error);
  if (of_system != nullptr && of_system->code() == std::errc::resource_unavailable_try_again)
    return "no more threads or processes can be started here. Fix: raise the limit (ulimit -u, systemd's "
           "TasksMax, docker's --pids-limit)";
  if (of_system != nullptr && of_system->code() == std::errc::too_many_files_open)
    return "no more files can be opened here. Fix: ulimit -n 1024";
  return error.what();
}

std::string this_program() {
  // Read once: once another ontime is installed there, the kernel says "… (deleted)".
  static const auto program = std::filesystem::read_symlink("/proc/self/exe").string();
  return program;
}

Process::Process(std::string name, const std::vector<std::string>& command, Between between)
    : name_(std::move(name)),
      command_(between.shown.empty() ? fmt::format("{}", fmt::join(command, " ")) : between.shown),
      between_(std::move(between)),
      spawned_(spawn(name_, command)),
      frames_(spawned_.out.get(), spawned_.in.get()) {
  try {
    frames_.put(between_.ahead, patience_ahead);
  } catch (const Broken&) {  // its output tells why, and is read later
  }
}

Process::Spawned Process::spawn(const std::string& name, const std::vector<std::string>& command) {
  auto orders = made_pipe(), events = made_pipe();
  const auto started = process::start(command, {orders.out.get(), events.in.get(), STDERR_FILENO});
  if (started.error != 0)
    throw Error(3, fmt::format("{} ({}) could not be started: {}", name, fmt::join(command, " "),
                               errno_text(started.error)));
  return {started.pid, std::move(orders.in), std::move(events.out)};
}

Process::~Process() {
  break_pipe();
  spawned_.out = process::Fd();
  if (let_go_) return;
  if (given_up_) kill(-spawned_.pid, SIGKILL);
  const auto patience = std::chrono::steady_clock::now() + longest_silence;
  while (waitpid(spawned_.pid, nullptr, WNOHANG) == 0) {
    if (std::chrono::steady_clock::now() > patience) kill(-spawned_.pid, SIGKILL);
    std::this_thread::sleep_for(5ms);
  }
}

void Process::break_pipe() { spawned_.in = process::Fd(); }

siginfo_t Process::end_without_reason() const {
  siginfo_t info{};
  for (int tries = 0; tries < 200 && info.si_pid == 0; ++tries) {
    if (tries > 0) std::this_thread::sleep_for(5ms);
    waitid(P_PID, static_cast<id_t>(spawned_.pid), &info, WEXITED | WNOHANG | WNOWAIT);
  }
  if (!between_.reason) return info;
  const bool left = info.si_pid != 0 && info.si_code == CLD_EXITED;
  const auto reason = between_.reason(left ? info.si_status : -1, frames_.text());
  if (!reason.empty()) throw Error(3, fmt::format("{}: {}", name_, reason));
  return info;
}

void Process::gone() const {
  const auto info = end_without_reason();
  if (info.si_pid == 0)
    throw Error(3, fmt::format("{} ({}) closed its pipe, but still runs", name_, command_));
  if (info.si_code != CLD_EXITED)
    throw Error(
        3, fmt::format("{} ({}) was killed by signal {} ({}){}", name_, command_, info.si_status,
                       sigdescr_np(info.si_status),
                       info.si_status == SIGKILL ? ": by a user, or by the kernel because memory ran out "
                                                   "on the machine or in a control group"
                                                 : ""));
  if (info.si_status == 127)
    throw Error(3, fmt::format("{} could not be started (exit code 127): {}. Is ontime installed there?",
                               name_, command_));
  throw Error(3, fmt::format("{} ({}) ended with exit code {}", name_, command_, info.si_status));
}

void Process::foreign(const std::string& what) const {
  end_without_reason();
  const auto said = frames_.text();
  throw Error(3, fmt::format("{}: {}{}", name_, what,
                             said.empty() ? "" : "; its output: " + said.substr(0, said.find('\n'))));
}

}  // namespace ontime::orders

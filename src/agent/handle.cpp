// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <cerrno>
#include <filesystem>
#include <system_error>
#include <thread>

#include <fcntl.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include "agent/agent.hpp"
#include "agent/frames.hpp"

namespace ontime::agent {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;

std::string errno_text(int code) { return std::generic_category().message(code); }

struct Pipe {
  Pipe() {
    if (pipe2(ends.data(), O_CLOEXEC) != 0) throw Error(3, "no pipe: " + errno_text(errno));
  }
  ~Pipe() {
    for (const int end : ends)
      if (end >= 0) close(end);
  }
  Pipe(const Pipe&) = delete;
  Pipe& operator=(const Pipe&) = delete;
  int release(std::size_t end) { return std::exchange(ends[end], -1); }
  std::array<int, 2> ends{-1, -1};
};

}  // namespace

struct Handle::Process {
  pid_t pid;
  int in, out;  // ours: we write to `in`, read from `out`
  Frames frames{out, in};
  std::string name;

  Process(pid_t pid_, int in_, int out_, std::string name_)
      : pid(pid_), in(in_), out(out_), name(std::move(name_)) {}
  ~Process() {
    close(in);
    close(out);
    const auto patience = std::chrono::steady_clock::now() + 10s;
    while (waitpid(pid, nullptr, WNOHANG) == 0) {
      if (std::chrono::steady_clock::now() > patience) kill(pid, SIGKILL);
      std::this_thread::sleep_for(5ms);
    }
  }
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  // How it ended, for people.
  [[noreturn]] void gone() {
    int status = 0;
    for (int tries = 0; tries < 200 && waitpid(pid, &status, WNOHANG | WNOWAIT) == 0; ++tries)
      std::this_thread::sleep_for(5ms);
    siginfo_t info{};
    waitid(P_PID, static_cast<id_t>(pid), &info, WEXITED | WNOHANG | WNOWAIT);
    if (info.si_code == CLD_KILLED || info.si_code == CLD_DUMPED)
      throw Error(3, fmt::format("the agent ({}) was ended by signal {} ({})", name, info.si_status,
                                 sigdescr_np(info.si_status)));
    if (info.si_status == 127) throw Error(3, fmt::format("the agent could not be started by: {}", name));
    throw Error(3, fmt::format("the agent ({}) left with exit code {}", name, info.si_status));
  }
};

Handle::Handle(const std::vector<std::string>& prefix) {
  auto command = prefix;
  command.push_back(std::filesystem::read_symlink("/proc/self/exe").string());
  command.push_back("agent");
  std::vector<char*> arguments;
  for (auto& word : command) arguments.push_back(word.data());
  arguments.push_back(nullptr);

  Pipe orders, events;
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, orders.ends[0], STDIN_FILENO);
  posix_spawn_file_actions_adddup2(&actions, events.ends[1], STDOUT_FILENO);
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP);
  pid_t pid = -1;
  const int failed = posix_spawnp(&pid, arguments[0], &actions, &attributes, arguments.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  posix_spawnattr_destroy(&attributes);
  const auto name = fmt::format("{}", fmt::join(command, " "));
  if (failed != 0)
    throw Error(3, fmt::format("the agent ({}) could not be started: {}", name, errno_text(failed)));
  process_ = std::make_unique<Process>(pid, orders.release(1), events.release(0), name);
}

Handle::~Handle() = default;
Handle::Handle(Handle&&) noexcept = default;

void Handle::order(const std::string& name, json body) {
  body["order"] = name;
  try {
    process_->frames.send(body);
  } catch (const Broken&) {
    event(0ms);  // it may have said why
    process_->gone();
  }
}

std::optional<json> Handle::event(std::chrono::milliseconds within) {
  try {
    auto event = process_->frames.receive(within);
    if (event && event->at("event") == "failed") throw Error(event->at("exit"), event->at("message"));
    return event;
  } catch (const Broken&) {
    process_->gone();
  }
}

}  // namespace ontime::agent

// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cerrno>
#include <chrono>
#include <system_error>
#include <utility>

#include <fmt/format.h>

#include "background/background.hpp"
#include "background/child.hpp"
#include "background/process.hpp"

namespace ontime::background {
namespace {

using namespace std::chrono_literals;

constexpr auto longest_start = 20s;  // 32 workers on one busy core need a second or two

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

Error not_started(int error) {
  if (error == ENOENT)
    return Error("load was asked for, but there is no stress-ng: install it (sudo apt install stress-ng)");
  return Error(fmt::format("stress-ng cannot be started: {}", std::generic_category().message(error)));
}

class Stress final : public Background {
 public:
  explicit Stress(std::unique_ptr<Child> child) : child_(std::move(child)) {}
  bool running() override { return !child_->ended(); }

 private:
  std::unique_ptr<Child> child_;
};

}  // namespace

std::unique_ptr<Background> stress(const Workers& workers, const std::string& directory,
                                   const Groups& groups) {
  const auto command = command_for(workers, directory);
  const long wanted = long{workers.cpu} + workers.vm + workers.io + workers.hdd;
  if (wanted == 0)
    throw Error("load without a worker was asked for: name a number of cpu, vm, io or hdd workers");
  const Output output;
  const auto started = start(command, output.fd(), groups);
  if (started.pid < 0) throw not_started(started.error);
  auto child = std::make_unique<Child>(started.pid);
  long running = 0;
  wait_until([&] { return child->ended() || (running = children_of(child->pid())) >= wanted; },
             longest_start);
  const bool has_ended = child->ended();
  if (!has_ended && running >= wanted) return std::make_unique<Stress>(std::move(child));
  child.reset();
  const auto what = has_ended ? "ended at once" : fmt::format("runs only {} of {} workers", running, wanted);
  throw Error(fmt::format("{} {}; it said:\n{}", fmt::join(command, " "), what, output.text()));
}

}  // namespace ontime::background

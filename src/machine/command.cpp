// SPDX-License-Identifier: Apache-2.0
#include "machine/command.hpp"

#include <cerrno>
#include <functional>
#include <system_error>
#include <thread>

#include <fcntl.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <signal.h>

#include "machine/machine.hpp"
#include "machine/proc.hpp"
#include "process/process.hpp"

namespace ontime::machine {
namespace {

process::Started start(const std::vector<std::string>& command, const process::Memory& output) {
  const process::Fd nothing(open("/dev/null", O_RDONLY | O_CLOEXEC));
  return process::start(command, {nothing.get(), output.fd(), output.fd()});
}

// Of the end of a child; nothing if the limit passed first, or it is interrupted: then it was killed.
std::optional<int> status_within(
    pid_t pid, std::chrono::nanoseconds limit,
    const std::function<bool()>& interrupted = [] { return false; }) {
  const auto end = std::chrono::steady_clock::now() + limit;
  bool in_time = true;
  while (!process::has_ended(pid)) {
    in_time = std::chrono::steady_clock::now() <= end && !interrupted();
    if (!in_time) kill(-pid, SIGKILL);
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  const int status = process::wait_for(pid);
  return in_time ? std::make_optional(status) : std::nullopt;
}

}  // namespace

std::string iproute2(const std::vector<std::string>& command, std::chrono::nanoseconds limit) {
  const process::Memory output;
  const auto asked = fmt::format("{}", fmt::join(command, " "));
  const auto started = start(command, output);
  if (started.error == ENOENT)
    throw Error(fmt::format("{}: no program `{}`. Fix: sudo apt install iproute2", asked, command.front()));
  if (started.error != 0)
    throw Error(fmt::format("{}: {}", asked, std::generic_category().message(started.error)));
  const auto status = status_within(started.pid, limit);
  if (!status) throw Error(fmt::format("{} was killed: it did not end in time", asked));
  if (status != 0)
    throw Error(fmt::format("{} failed: {}", asked, word(output.text()).value_or("no error message")));
  return output.text();
}

std::optional<std::string> answer_of(const std::vector<std::string>& command, std::chrono::nanoseconds limit,
                                     const std::function<bool()>& interrupted) {
  const process::Memory output;
  const auto started = start(command, output);
  if (started.error != 0) return {};
  if (status_within(started.pid, limit, interrupted) != 0) return {};
  return output.text();
}

}  // namespace ontime::machine

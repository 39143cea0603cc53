// SPDX-License-Identifier: Apache-2.0
#include "lab/lab.hpp"

#include <cerrno>
#include <csignal>
#include <memory>
#include <sstream>
#include <string_view>
#include <system_error>
#include <thread>

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <sys/wait.h>
#include <unistd.h>

#include "background/background.hpp"
#include "background/child.hpp"
#include "lab/console.hpp"
#include "lab/guest.hpp"
#include "lab/qemu.hpp"
#include "lab/results.hpp"
#include "process/process.hpp"

namespace ontime::lab {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

constexpr std::chrono::seconds time_to_boot = 15min, time_to_boot_by_kvm = 30s;
constexpr auto between_looks = 200ms;

struct Prepared {
  Files files;
  std::function<std::vector<std::string>(Accelerator)> command;  // QEMU's
};

// Linux unpacks the files into at most half of its memory; the command's files are stored there, too.
void check_room(const Machine& machine, std::uint64_t files_bytes) {
  constexpr std::uint64_t for_all_else = std::uint64_t{256} << 20U;
  if (const auto needed = 2 * files_bytes + for_all_else; machine.memory_bytes < needed)
    throw Error(
        fmt::format("the lab's machine has {} MiB of memory. Its {} MiB of files need {} MiB. Fix: increase "
                    "--memory, or copy less --with",
                    machine.memory_bytes >> 20U, files_bytes >> 20U, needed >> 20U));
}

Prepared prepare(const Machine& machine, journal::Journal& journal, const std::vector<std::string>& command,
                 const std::vector<File>& brought, const Observer& observer) {
  try {
    const auto version = check_qemu(machine);
    const auto kernel = fetch_kernel(machine.kernel, observer.note);
    Files files(journal::add_directory(journal, "lab"));
    image_of(machine, kernel, command, brought).write(files.image);
    check_room(machine, fs::file_size(files.image));
    return {files, [=, &machine, at_terminal = command.empty()](Accelerator accelerator) {
              return qemu_command(machine, accelerator, version, kernel.image, files, at_terminal);
            }};
  } catch (const background::Error& error) {
    throw Error(error.what());
  } catch (const fs::filesystem_error& error) {
    throw Error(error.what());
  }
}

std::chrono::milliseconds since(Clock::time_point then) {
  return std::chrono::duration_cast<std::chrono::milliseconds>(Clock::now() - then);
}

class Running {
 public:
  Running(const Prepared& machine, Accelerator accelerator, const Observer& observer)
      : observer_(observer),
        console_(emptied(machine.files.console)),
        words_(emptied(machine.files.words)),
        arrivals_(emptied(machine.files.results)),
        arrived_(machine.files.arrived),
        qemu_(started(machine.command(accelerator))) {}

  // Waits until it is up, but not longer than `within`.
  bool comes_up(std::chrono::seconds within) {
    while (!up_ && !ended_ && since(start_) < within) look();
    return up_;
  }
  Outcome watch() {
    if (!comes_up(time_to_boot)) fail(ended_ ? "it stopped during boot" : "its boot timed out");
    while (!ended_) look();
    if (!outcome_) fail("it stopped before its command ended");
    return *outcome_;
  }

  [[noreturn]] void fail(const std::string& how) const {
    const auto said = output_.text();
    throw Error(fmt::format("the lab's machine failed: {}. The last lines of its console:\n{}{}{}", how,
                            console_.tail(), said.empty() ? "" : "\nand of QEMU:\n", said));
  }

 private:
  pid_t started(const std::vector<std::string>& command) {
    // `nice ontime lab` is to leave the CPUs to other programs: QEMU is what needs them.
    const auto qemu = background::start(command, output_.fd(), {}, background::Scheduling::callers);
    if (qemu.pid < 0)
      throw Error(fmt::format("{} cannot be started: {}", command.front(),
                              std::generic_category().message(qemu.error)));
    return qemu.pid;
  }

  // Removes the file of an earlier machine.
  static const fs::path& emptied(const fs::path& file) {
    fs::remove(file);
    return file;
  }

  void look() {
    ended_ = qemu_.ended();
    for (const auto& line : words_.lines(ended_)) take(line);
    while (arrivals_.next(arrived_)) observer_.sent(arrived_);
    if (observer_.interrupted()) throw Interrupted();
    observer_.waits(std::chrono::duration_cast<std::chrono::seconds>(since(start_)),
                    up_ ? std::make_optional(words_.present()) : std::nullopt);
    if (!ended_) std::this_thread::sleep_for(between_looks);
  }

  void take(const std::string& line) {
    if (!up_)
      up_ = line == up;
    else if (line.starts_with(ended))
      outcome_ = outcome_of(line.substr(std::string_view(ended).size()));
    else
      observer_.says(line);
  }

  Outcome outcome_of(const std::string& code_and_uptime) const {
    std::istringstream text(code_and_uptime);
    int code = 0;
    double uptime_s = 0;
    if (!(text >> code >> uptime_s)) fail("it stopped before its command ended");
    return {code,
            std::chrono::duration_cast<std::chrono::milliseconds>(std::chrono::duration<double>(uptime_s)),
            since(start_)};
  }

  const Observer& observer_;
  const Clock::time_point start_ = Clock::now();
  Console console_, words_;
  Arrivals arrivals_;
  const fs::path arrived_;
  process::Memory output_;
  background::Child qemu_;
  bool up_ = false, ended_ = false;
  std::optional<Outcome> outcome_;
};

// Under KVM if the machine is live and boots under it; otherwise emulated.
std::unique_ptr<Running> started(const Machine& machine, const Prepared& prepared, const Observer& observer) {
  if (!machine.deterministic && may_use_kvm()) {
    auto by_kvm = std::make_unique<Running>(prepared, Accelerator::kvm, observer);
    if (by_kvm->comes_up(time_to_boot_by_kvm)) return by_kvm;
    observer.note(fmt::format("the lab's machine did not boot under KVM within {}. QEMU emulates it instead",
                              time_to_boot_by_kvm));
  }
  return std::make_unique<Running>(prepared, Accelerator::emulation, observer);
}

}  // namespace

Outcome run(const Machine& machine, journal::Journal& journal, const std::vector<std::string>& command,
            const std::vector<File>& files, const Observer& observer) {
  const auto prepared = prepare(machine, journal, command, files, observer);
  return started(machine, prepared, observer)->watch();
}

void shell(const Machine& machine, journal::Journal& journal, const Observer& observer) {
  auto command = prepare(machine, journal, {}, {}, observer).command(Accelerator::emulation);
  command.insert(command.begin(), {"setpriv", "--pdeathsig=KILL"});  // QEMU ends with this process
  const auto qemu =
      process::start(command, {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}, process::Group::callers);
  if (qemu.error != 0)
    throw Error(
        fmt::format("QEMU cannot be started by setpriv: {}", std::generic_category().message(qemu.error)));
  int status = 0;
  while (waitpid(qemu.pid, &status, 0) < 0 && errno == EINTR)
    if (observer.interrupted()) kill(qemu.pid, SIGTERM);
  if (status != 0) throw Error("QEMU failed");
}

}  // namespace ontime::lab

// SPDX-License-Identifier: Apache-2.0
#include "background/child.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <sstream>
#include <system_error>
#include <thread>
#include <tuple>
#include <utility>

#include <fcntl.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <linux/capability.h>
#include <poll.h>
#include <sched.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include "background/background.hpp"
#include "realtime/privileges.hpp"

namespace ontime::background {
namespace {

using namespace std::chrono_literals;

constexpr auto time_to_end = 3s;
constexpr auto time_to_die = 10s;  // of a killed process; in an uninterruptible call it may need hours

struct Plan {
  char* const* arguments;
  int output;
  int parent;  // a pidfd: inside a PID namespace getppid() says nothing
  const std::vector<std::string>* groups;
  Scheduling scheduling;
  int isolation;
  int error;
};

bool gone(int pidfd) {
  pollfd ended{pidfd, POLLIN, 0};
  return poll(&ended, 1, 0) > 0;
}

// By system call: a sanitizer's sigaction() would record it in the parent's memory.
void default_all_signals() {
  constexpr std::array<unsigned long, 4> by_default{};  // the kernel's struct sigaction with SIG_DFL
  constexpr std::size_t mask_bytes = 8;
  for (int number = 1; number < NSIG; ++number)
    syscall(SYS_rt_sigaction, number, by_default.data(), nullptr, mask_bytes);
}

void become_ordinary() {
  const sched_param no_priority{};
  sched_setscheduler(0, SCHED_OTHER, &no_priority);
  // Load of `nice ontime` would yield to everything. Without root the kernel does not let it be raised.
  setpriority(PRIO_PROCESS, 0, 0);
  constexpr int of_process = 1, by_niceness = 0;
  syscall(SYS_ioprio_set, of_process, 0, by_niceness);
  cpu_set_t all;
  std::memset(&all, 0xff, sizeof all);
  sched_setaffinity(0, sizeof all, &all);
}

// Killed, the first process of a PID namespace takes all others with it. Without a namespace, a killed
// stress-ng leaves workers that it has just forked: it can end these itself.
int end_with_parent(bool is_isolated) { return is_isolated ? SIGKILL : SIGTERM; }

// Runs in the parent's memory while the parent waits: only system calls are allowed.
int run(void* argument) {
  auto* const plan = static_cast<Plan*>(argument);
  prctl(PR_SET_PDEATHSIG, end_with_parent(plan->isolation != 0));
  if (gone(plan->parent)) _exit(1);
  setpgid(0, 0);
  for (const auto& group : *plan->groups) {
    const int file = open(group.c_str(), O_WRONLY | O_CLOEXEC);
    if (file < 0 || write(file, "0", 1) != 1) {
      plan->error = errno == ENOENT ? ENODEV : errno;  // it is not the program that is missing
      _exit(127);
    }
  }
  default_all_signals();
  if (plan->scheduling == Scheduling::ordinary) become_ordinary();
  sigset_t none;
  sigemptyset(&none);
  pthread_sigmask(SIG_SETMASK, &none, nullptr);
  const int nothing = open("/dev/null", O_RDONLY | O_CLOEXEC);
  dup2(nothing, STDIN_FILENO);
  dup2(plan->output, STDOUT_FILENO);
  dup2(plan->output, STDERR_FILENO);
  execvp(plan->arguments[0], plan->arguments);
  plan->error = errno;
  _exit(127);
}

// No signal handler may run in the child: it would run in the parent's memory.
class SignalsBlocked {
 public:
  SignalsBlocked() {
    sigset_t all;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before_);
  }
  ~SignalsBlocked() { pthread_sigmask(SIG_SETMASK, &before_, nullptr); }
  SignalsBlocked(const SignalsBlocked&) = delete;
  SignalsBlocked& operator=(const SignalsBlocked&) = delete;

 private:
  sigset_t before_;
};

// The leader of a PID namespace ends after all its descendants; without a namespace they may end later.
bool group_gone(pid_t group) {
  const auto all = processes();
  return std::none_of(all.begin(), all.end(), [group](const auto& process) {
    return process.group == group && process.pid != group && !process.has_ended();
  });
}

bool has_nobody(const char* map) {
  std::istringstream ranges(process::text_of(map).value_or("0 0 4294967295"));
  for (uid_t first = 0, outside = 0, count = 0; ranges >> first >> outside >> count;)
    if (nobody >= first && nobody - first < count) return true;
  return false;
}

}  // namespace

Started start(const std::vector<std::string>& command, int output, const std::vector<std::string>& groups,
              Scheduling scheduling) {
  process::heed_ends_of_children();
  std::vector<char*> arguments;
  arguments.reserve(command.size() + 1);
  for (const auto& word : command) arguments.push_back(const_cast<char*>(word.c_str()));
  arguments.push_back(nullptr);
  Plan plan{arguments.data(),
            output,
            static_cast<int>(syscall(SYS_pidfd_open, getpid(), 0)),
            &groups,
            scheduling,
            0,
            0};

  // Not fork(): its copy-on-write would make locked pages of ours fault again.
  constexpr std::size_t stack_bytes = 32768;
  alignas(16) std::array<char, stack_bytes> stack;
  pid_t pid = -1;
  {
    const SignalsBlocked blocked;
    // In a user namespace without an id map, root has no rights to files and to other users any more.
    for (const int isolation : {CLONE_NEWPID, geteuid() == 0 ? 0 : CLONE_NEWUSER | CLONE_NEWPID, 0}) {
      plan.isolation = isolation;
      plan.error = 0;
      pid = clone(run, stack.data() + stack.size(), CLONE_VM | CLONE_VFORK | SIGCHLD | isolation, &plan);
      if (pid >= 0) break;
      plan.error = errno;
    }
  }
  close(plan.parent);
  if (pid >= 0 && plan.error != 0) waitpid(pid, nullptr, 0);
  return {plan.error == 0 ? pid : -1, plan.error};
}

std::vector<std::string> as_nobody(bool with_folder) {
  // Where no other user is mapped, as in a rootless container, root has the rights of an ordinary user only.
  if (geteuid() != 0 || !has_nobody("/proc/self/uid_map") || !has_nobody("/proc/self/gid_map")) return {};
  std::vector<std::string> missing;
  for (const auto& [capability, name, is_for_folder] : {std::tuple(CAP_SETUID, "SETUID", false),
                                                        {CAP_SETGID, "SETGID", false},
                                                        {CAP_KILL, "KILL", false},
                                                        {CAP_CHOWN, "CHOWN", true},
                                                        {CAP_DAC_OVERRIDE, "DAC_OVERRIDE", true}})
    if ((with_folder || !is_for_folder) && !realtime::capable(capability)) missing.emplace_back(name);
  if (!missing.empty())
    throw Error(fmt::format(
        "load and traffic run as the user nobody: for that, ontime lacks the capabilit{} {}. Fix: start the "
        "container with --cap-add {}",
        missing.size() == 1 ? "y" : "ies", fmt::join(missing, ", "), fmt::join(missing, " --cap-add ")));
  // The kernel clears the parent-death signal when the user changes, so setpriv sets it again.
  return {"setpriv",
          fmt::format("--reuid={}", nobody),
          fmt::format("--regid={}", nobody),
          "--clear-groups",
          "--no-new-privs",
          fmt::format("--pdeathsig={}", sigabbrev_np(end_with_parent(realtime::capable(CAP_SYS_ADMIN))))};
}

Child::~Child() {
  if (end()) return;
  const auto limit = *asked_ + time_to_end + time_to_die - std::chrono::steady_clock::now();
  wait_until([this] { return end(); }, limit);
}

bool Child::end() {
  if (pid_ < 0) return true;
  const auto now = std::chrono::steady_clock::now();
  if (!asked_) {
    asked_ = now;
    kill(-pid_, SIGTERM);
  }
  if (!ended() && now - *asked_ < time_to_end) return false;
  kill(-pid_, SIGKILL);
  if (!ended() || !group_gone(pid_)) return false;
  waitpid(std::exchange(pid_, -1), nullptr, 0);
  return true;
}

// Does not reap the process: its id and its group's must not be reused yet.
bool Child::ended() const { return pid_ < 0 || process::has_ended(pid_); }

int Child::exit_code() const {
  siginfo_t info{};
  waitid(P_PID, static_cast<id_t>(pid_), &info, WEXITED | WNOHANG | WNOWAIT);
  return info.si_pid == pid_ && info.si_code == CLD_EXITED ? info.si_status : -1;
}

bool is_of_missing_program(int exit_code, const std::string& output) {
  // The dynamic loader has the same code, and names the library that is missing.
  return exit_code == 127 && output.find("error while loading shared libraries") == output.npos;
}

std::string output_of(const std::vector<std::string>& command, const std::string& package,
                      std::chrono::nanoseconds limit) {
  const process::Memory output;
  const auto started = start(command, output.fd());
  if (started.pid < 0) {
    if (started.error == ENOENT)
      throw Error(fmt::format("{} is not installed. Fix: sudo apt install {}", command.front(), package));
    throw Error(fmt::format("{} cannot be started: {}", command.front(),
                            std::generic_category().message(started.error)));
  }
  const Child child(started.pid);
  const bool ended = wait_until([&] { return child.ended(); }, limit);
  if (child.exit_code() == 0) return output.text();
  throw Error(fmt::format("{} {}: {}", fmt::join(command, " "), ended ? "failed" : "timed out",
                          output.text().substr(0, 2000)));
}

bool wait_until(const std::function<bool()>& condition, std::chrono::nanoseconds limit) {
  for (const auto end = std::chrono::steady_clock::now() + limit; !condition();
       std::this_thread::sleep_for(5ms))
    if (std::chrono::steady_clock::now() > end) return false;
  return true;
}

std::vector<process::Stat> processes() {
  std::vector<process::Stat> found;
  for (const auto& entry : std::filesystem::directory_iterator("/proc")) {
    if (std::isdigit(static_cast<unsigned char>(entry.path().filename().c_str()[0])) == 0) continue;
    const auto text = process::text_of(entry.path() / "stat").value_or("");
    if (auto process = process::parse_stat(text)) found.push_back(std::move(*process));
  }
  return found;
}

}  // namespace ontime::background

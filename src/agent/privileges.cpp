// SPDX-License-Identifier: Apache-2.0
#include "agent/privileges.hpp"

#include <array>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <thread>

#include <linux/capability.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <unistd.h>

namespace ontime::agent {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

std::atomic<std::uint64_t> kept = (1ULL << CAP_SYS_NICE) | (1ULL << CAP_IPC_LOCK);
constexpr auto patience = 2s;  // with a thread that is not scheduled

// The kernel knows capabilities of threads, not of processes: each has to do this. System calls alone.
void drop_own(int) {
  const int before = errno;
  __user_cap_header_struct header{_LINUX_CAPABILITY_VERSION_3, 0};
  std::array<__user_cap_data_struct, _LINUX_CAPABILITY_U32S_3> sets{};
  prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0);
  if (syscall(SYS_capget, &header, sets.data()) == 0) {
    for (std::size_t half = 0; half < sets.size(); ++half) {
      const auto mask = static_cast<std::uint32_t>(kept >> (32 * half));
      sets[half].effective &= mask;
      sets[half].permitted &= mask;
      sets[half].inheritable = 0;
    }
    syscall(SYS_capset, &header, sets.data());
  }
  errno = before;
}

// The thread's name if it has other capabilities than `kept`; else "".
std::string has_more(const fs::path& task) {
  std::ifstream status(task / "status");
  std::string word, name, mask;
  while (status >> word) {
    if (word == "Name:") status >> name;
    if (word == "CapPrm:" && status >> mask)
      return (std::strtoull(mask.c_str(), nullptr, 16) & ~kept) != 0 ? name : "";
  }
  return "";  // it has ended
}

}  // namespace

std::vector<std::string> drop_privileges(bool count_instructions) {
  if (count_instructions) kept |= 1ULL << CAP_PERFMON;
  // The handler stays installed: a second signal may be on its way to a thread that has already dropped them.
  struct sigaction drop {};
  drop.sa_handler = drop_own;
  drop.sa_flags = SA_RESTART;
  sigaction(SIGXCPU, &drop, nullptr);
  drop_own(0);
  std::vector<std::string> left;
  const auto end = std::chrono::steady_clock::now() + patience;
  do {
    left.clear();
    for (const auto& task : fs::directory_iterator("/proc/self/task")) {
      auto name = has_more(task.path());
      if (name.empty()) continue;
      left.push_back(std::move(name));
      syscall(SYS_tgkill, getpid(), std::stoi(task.path().filename().string()), SIGXCPU);
    }
    if (!left.empty()) std::this_thread::sleep_for(2ms);
  } while (!left.empty() && std::chrono::steady_clock::now() < end);
  return left;
}

}  // namespace ontime::agent

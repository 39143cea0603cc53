// SPDX-License-Identifier: Apache-2.0
#include "transport/fastdds/threads.hpp"

#include <chrono>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <system_error>
#include <thread>

#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/syscall.h>

#include "transport/dds.hpp"

namespace ontime::transport::fastdds {
namespace {

struct SystemCall {
  long number;
  int first_argument;
};

std::filesystem::path task_folder(pid_t tid) { return "/proc/self/task/" + std::to_string(tid); }

// What the thread sleeps in; nothing if it runs, or if the kernel does not tell.
std::optional<SystemCall> sleeps_in(pid_t tid) {
  std::ifstream in(task_folder(tid) / "syscall");
  SystemCall call{};
  long argument = 0;
  if (!(in >> call.number >> std::hex >> argument) || call.number < 0) return {};
  call.first_argument = static_cast<int>(argument);
  return call;
}

std::optional<SystemCall> await_sleep(pid_t tid) {
  for (int i = 0; i < 50; ++i) {
    if (const auto call = sleeps_in(tid)) return call;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return {};
}

int port_of(int socket) {
  sockaddr_in address{};
  socklen_t bytes = sizeof address;
  if (getsockname(socket, reinterpret_cast<sockaddr*>(&address), &bytes) != 0) return 0;
  return ntohs(address.sin_port);
}

// RTPS: multicast of discovery and users at 0 and 1, then unicast of the two in turns.
bool is_discovery(int port, int domain) {
  const int offset = port - dds::base_port - dds::ports_per_domain * domain;
  return offset >= 0 && offset < dds::ports_per_domain && offset % 2 == 0;
}

std::string name_of(pid_t tid) {
  std::string name;
  std::getline(std::ifstream(task_folder(tid) / "comm"), name);
  return name;
}

}  // namespace

std::vector<pid_t> tasks() {
  std::vector<pid_t> found;
  std::error_code ended;  // while we looked
  for (const auto& task : std::filesystem::directory_iterator("/proc/self/task", ended))
    found.push_back(std::stoi(task.path().filename()));
  return found;
}

std::vector<Thread> tell_apart(const std::vector<pid_t>& threads, int domain) {
  std::vector<Thread> found;
  for (const pid_t tid : threads) {
    const auto call = await_sleep(tid);
    std::string role = "other";
    std::string name = name_of(tid);
    if (call && (call->number == SYS_recvmsg || call->number == SYS_recvfrom)) {
      const int port = port_of(call->first_argument);
      role = is_discovery(port, domain) ? "discovery" : "receive";
      name += ":" + std::to_string(port);
    } else if (call && call->number == SYS_futex) {
      // A participant starts its timer first. What waits beside it sends what is published asynchronously.
      role = tid == threads.front() ? "timer" : "send";
    }
    found.push_back({tid, role, name});
  }
  return found;
}

}  // namespace ontime::transport::fastdds

// SPDX-License-Identifier: Apache-2.0
#include "transport/fastdds/threads.hpp"

#include <algorithm>
#include <charconv>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <optional>
#include <sstream>
#include <string>
#include <string_view>
#include <system_error>
#include <thread>

#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/syscall.h>

#include "transport/clock.hpp"
#include "transport/dds.hpp"

namespace ontime::transport::fastdds {
namespace {

using dds::name_of;

constexpr std::int64_t patience_ns = 20'000'000;  // with threads that do not sleep, all together

struct SystemCall {
  long number;
  std::uint64_t first_argument;
};

bool receives_in(const SystemCall& call) { return call.number == SYS_recvmsg || call.number == SYS_recvfrom; }
bool tells_its_role(const SystemCall& call) { return receives_in(call) || call.number == SYS_futex; }

// What the thread sleeps in; nothing if it runs until then, or if the kernel does not tell. A call that tells
// nothing may be one in passing: a thread that was just started maps its memory first.
std::optional<SystemCall> sleeps_in(pid_t tid, std::int64_t until_ns) {
  for (;;) {
    std::ifstream in("/proc/self/task/" + std::to_string(tid) + "/syscall");
    std::string word;
    if (!(in >> word)) return {};
    SystemCall call{};
    const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), call.number);
    const bool sleeps = error == std::errc{} && call.number >= 0 && in >> std::hex >> call.first_argument;
    if (sleeps && (tells_its_role(call) || now_ns() >= until_ns)) return call;
    if (now_ns() >= until_ns) return {};
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

int port_of(int socket) {
  sockaddr_in address{};
  socklen_t bytes = sizeof address;
  if (getsockname(socket, reinterpret_cast<sockaddr*>(&address), &bytes) != 0 ||
      address.sin_family != AF_INET)
    return 0;
  return ntohs(address.sin_port);
}

// Of the vendor's shared memory, the port that this address lies in; 0: in none. What receives there sleeps
// in it.
int shared_memory_port_of(std::uint64_t address) {
  constexpr std::string_view named = "/fastrtps_port";
  std::ifstream maps("/proc/self/maps");
  for (std::string line; std::getline(maps, line);) {
    std::istringstream in(line);
    std::uint64_t from = 0, to = 0;
    char dash = 0;
    if (!(in >> std::hex >> from >> dash >> to) || address < from || address >= to) continue;
    int port = 0;
    if (const auto at = line.find(named); at != line.npos)
      std::from_chars(line.data() + at + named.size(), line.data() + line.size(), port);
    return port;
  }
  return 0;
}

// RTPS: multicast of discovery and users at 0 and 1, then unicast of the two in turns.
bool is_discovery(int port, int domain) {
  const int offset = port - dds::base_port - dds::ports_per_domain * domain;
  return offset >= 0 && offset < dds::ports_per_domain && offset % 2 == 0;
}

const char* role_of_port(int port, int domain) {
  return is_discovery(port, domain) ? "discovery" : "receive";
}

// Of the one participant of this process, the ports that its sockets receive at, in the order in which it
// opens them: discovery's first. Nothing if there are several participants, or sockets of another kind.
std::vector<int> receiving_ports(int domain) {
  constexpr int first_unicast = 10;
  std::vector<int> ports;
  std::optional<int> participant;
  std::error_code ended;
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd", ended)) {
    const int port = port_of(std::stoi(entry.path().filename()));
    const int offset = port - dds::base_port - dds::ports_per_domain * domain;
    if (offset < 0 || offset >= dds::ports_per_domain) continue;
    ports.push_back(port);
    if (offset < first_unicast) continue;
    const int whose = (offset - first_unicast) / 2;
    if (participant.value_or(whose) != whose) return {};
    participant = whose;
  }
  std::stable_partition(ports.begin(), ports.end(), [&](int port) { return is_discovery(port, domain); });
  return ports;
}

// By the order in which they were started; nothing where threads and sockets do not come out even.
std::vector<std::string> roles_by_order(std::size_t threads, int domain) {
  const auto ports = receiving_ports(domain);
  const std::size_t beside = 1 + ports.size();  // what sends asynchronously is one at most
  if (ports.empty() || threads < beside || threads > beside + 1) return {};
  std::vector<std::string> roles{"timer"};
  for (const int port : ports) roles.emplace_back(role_of_port(port, domain));
  if (threads > beside) roles.emplace_back("resend");
  return roles;
}

// 2.14 and 3 name theirs: "dds.udp.7411", "dds.shm.7411", "dds.tcp.…", "dds.dsha.…" (data sharing),
// "dds.ev.0", "dds.shm.wdog", "dds.asyn.0.0" and others.
std::optional<Thread> by_its_name(pid_t tid, int domain) {
  const std::string name = name_of(tid);
  if (!name.starts_with("dds.")) return {};
  int port = 0;
  for (const std::string_view receives : {"dds.udp.", "dds.shm.", "dds.tcp."})
    if (name.starts_with(receives))
      std::from_chars(name.data() + receives.size(), name.data() + name.size(), port);
  if (port != 0) return Thread{tid, role_of_port(port, domain), name};
  if (name.starts_with("dds.dsha.")) return Thread{tid, "receive", name};
  if (name.starts_with("dds.ev.") || name == "dds.shm.wdog") return Thread{tid, "timer", name};
  return Thread{tid, name.starts_with("dds.asyn.") ? "resend" : "other", name};
}

// `before_receivers`: nothing that receives was started before it.
Thread by_what_it_sleeps_in(pid_t tid, const SystemCall& call, bool before_receivers, int domain) {
  if (receives_in(call)) {
    const int port = port_of(static_cast<int>(call.first_argument));
    return {tid, role_of_port(port, domain), name_of(tid) + ":" + std::to_string(port)};
  }
  if (call.number != SYS_futex) return {tid, "other", name_of(tid)};
  if (const int port = shared_memory_port_of(call.first_argument); port != 0)
    return {tid, role_of_port(port, domain), name_of(tid) + ":shm" + std::to_string(port)};
  // A participant starts its timer before all that receives, and shared memory its watchdog before that. What
  // waits beside them sends again, and what is published asynchronously.
  return {tid, before_receivers ? "timer" : "resend", name_of(tid)};
}

}  // namespace

std::vector<Thread> tell_apart(const std::vector<pid_t>& threads, int domain) {
  const std::int64_t until_ns = now_ns() + patience_ns;
  const auto by_order = roles_by_order(threads.size(), domain);
  std::vector<Thread> found;
  for (const pid_t tid : threads) {
    const std::size_t place = found.size();
    const bool before_receivers = std::ranges::none_of(
        found, [](const Thread& thread) { return thread.role == "receive" || thread.role == "discovery"; });
    const auto call = sleeps_in(tid, until_ns);  // by then it has named itself
    if (auto named = by_its_name(tid, domain)) {
      found.push_back(*std::move(named));
      continue;
    }
    // Any thread may wait for a lock as it is looked at: where the order tells, it tells more than that.
    if (call && (receives_in(*call) || by_order.empty()))
      found.push_back(by_what_it_sleeps_in(tid, *call, before_receivers, domain));
    else
      found.push_back({tid, place < by_order.size() ? by_order[place] : "unknown", name_of(tid)});
  }
  return found;
}

}  // namespace ontime::transport::fastdds

// SPDX-License-Identifier: Apache-2.0
// The link under test: whether it exists, and that all DDS packets use it.
#include <filesystem>
#include <fstream>
#include <memory>
#include <optional>
#include <set>
#include <sstream>

#include <ifaddrs.h>
#include <sys/socket.h>
#include <sys/stat.h>

#include "transport/dds.hpp"
#include "transport/sockets.hpp"

namespace ontime::transport::dds {
namespace {

std::optional<unsigned> flags_of(const std::string& interface, const std::string& address) {
  ifaddrs* list = nullptr;
  if (getifaddrs(&list) != 0) return {};
  const std::unique_ptr<ifaddrs, decltype(&freeifaddrs)> owner(list, freeifaddrs);
  for (const ifaddrs* entry = list; entry != nullptr; entry = entry->ifa_next)
    if (entry->ifa_name == interface && entry->ifa_addr != nullptr && entry->ifa_addr->sa_family == AF_INET &&
        text_of(reinterpret_cast<const sockaddr_in*>(entry->ifa_addr)->sin_addr) == address)
      return entry->ifa_flags;
  return {};
}

// The interfaces on which a program of this host has joined RTPS's multicast group, which all domains share.
std::set<std::string> interfaces_of_group() {
  in_addr group{};
  inet_pton(AF_INET, multicast_group, &group);
  std::set<std::string> found;
  std::ifstream in("/proc/net/igmp");
  std::string interface;
  for (std::string line; std::getline(in, line);) {
    std::istringstream words(line);
    std::string first, second;
    words >> first >> second;
    if (!line.starts_with('\t'))
      interface = second;
    else if (std::uint32_t joined = 0;
             std::istringstream(first) >> std::hex >> joined && joined == group.s_addr)
      found.insert(interface);
  }
  return found;
}

// Whether another process's socket has the discovery port of the domain.
bool others_listen(int domain) {
  std::set<std::uint64_t> ours;
  for (const auto& [descriptor, number] : sockets()) ours.insert(number);
  std::ifstream in("/proc/net/udp");
  std::string line;
  std::getline(in, line);
  while (std::getline(in, line)) {
    std::istringstream words(line);
    std::string skipped, local;
    words >> skipped >> local;
    std::uint64_t number = 0;
    for (int i = 0; i < 7; ++i) words >> skipped;
    words >> number;
    const auto colon = local.find(':');
    if (colon == std::string::npos) continue;
    const int port = std::stoi(local.substr(colon + 1), nullptr, 16);
    if (port == base_port + ports_per_domain * domain && !ours.contains(number)) return true;
  }
  return false;
}

}  // namespace

// Fast DDS sends nothing on a link that is down.
void check_link(const Config& config, const std::string& transport) {
  await_running([&] { return flags_of(config.interface, config.address); }, transport, config.interface,
                " with address " + config.address + " (see ip address)");
}

Sockets sockets() {
  Sockets found;
  std::error_code ended;  // while we looked
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd", ended)) {
    const int descriptor = std::stoi(entry.path().filename());
    int family = 0;
    socklen_t bytes = sizeof family;
    struct stat status {};
    if (getsockopt(descriptor, SOL_SOCKET, SO_DOMAIN, &family, &bytes) == 0 &&
        (family == AF_INET || family == AF_INET6) && fstat(descriptor, &status) == 0)
      found[descriptor] = status.st_ino;
  }
  return found;
}

void keep_to_link(const Sockets& before, const Config& config, const std::string& transport) {
  if (config.interface.empty()) return;
  for (const auto& [descriptor, number] : sockets()) {
    if (const auto old = before.find(descriptor); old != before.end() && old->second == number) continue;
    if (setsockopt(descriptor, SOL_SOCKET, SO_BINDTODEVICE, config.interface.c_str(),
                   static_cast<socklen_t>(config.interface.size())) != 0)
      throw Error(transport + ": cannot bind a socket to the interface " + config.interface + ": " +
                  errno_text() +
                  "; Linux before 5.7 needs CAP_NET_RAW for it. Fix: grant it, or name no interface");
  }
}

std::string others_elsewhere(const Config& config) {
  if (config.interface.empty() || !others_listen(config.domain)) return {};
  std::string elsewhere;
  for (const std::string& interface : interfaces_of_group())
    if (interface != config.interface) elsewhere += (elsewhere.empty() ? "" : ", ") + interface;
  if (elsewhere.empty()) return {};
  return "a participant on this host uses multicast on " + elsewhere + ", not on " + config.interface +
         ". Fix: use the same interface for both, or name none here";
}

}  // namespace ontime::transport::dds

// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cerrno>
#include <filesystem>
#include <functional>
#include <memory>
#include <system_error>
#include <thread>
#include <utility>

#include <fmt/format.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <netdb.h>
#include <netinet/in.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

#include "journal/journal.hpp"
#include "machine/machine.hpp"
#include "machine/proc.hpp"
#include "process/process.hpp"

namespace ontime::machine {
namespace {

std::string name_of(const ifaddrs& address) {
  const std::string label = address.ifa_name;  // an address may have a label: eth0:1
  return label.substr(0, label.find(':'));
}

Interface& entry_of(std::vector<Interface>& all, const ifaddrs& address) {
  const auto name = name_of(address);
  const auto known = std::ranges::find(all, name, &Interface::name);
  if (known != all.end()) return *known;
  const auto flags = address.ifa_flags;
  return all.emplace_back(Interface{name, {}, (flags & IFF_UP) != 0, (flags & IFF_LOOPBACK) != 0});
}

using Addresses = std::unique_ptr<ifaddrs, decltype(&freeifaddrs)>;

Addresses addresses() {
  ifaddrs* first = nullptr;
  if (getifaddrs(&first) != 0)
    throw Error(fmt::format("cannot list the network interfaces of this machine: {}",
                            std::generic_category().message(errno)));
  return {first, freeifaddrs};
}

struct Address {
  sockaddr_storage storage{};
  socklen_t bytes = 0;
};

Address address_of(const std::string& name) {
  addrinfo hints{};
  hints.ai_socktype = SOCK_DGRAM;
  addrinfo* found = nullptr;
  if (const int error = getaddrinfo(name.c_str(), "9", &hints, &found); error != 0)
    throw Error(fmt::format("'{}' is not an address or known host: {}", name, gai_strerror(error)));
  const std::unique_ptr<addrinfo, decltype(&freeaddrinfo)> owned(found, freeaddrinfo);
  Address address;
  address.bytes = owned->ai_addrlen;
  std::copy_n(reinterpret_cast<const char*>(owned->ai_addr), address.bytes,
              reinterpret_cast<char*>(&address.storage));
  return address;
}

std::string numeric(const sockaddr& address) {
  const auto size = address.sa_family == AF_INET6 ? sizeof(sockaddr_in6) : sizeof(sockaddr_in);
  std::array<char, NI_MAXHOST> text{};
  const int failed = getnameinfo(&address, static_cast<socklen_t>(size), text.data(),
                                 static_cast<socklen_t>(text.size()), nullptr, 0, NI_NUMERICHOST);
  return failed == 0 ? text.data() : "";
}

std::string numeric(const Address& address) {
  return numeric(reinterpret_cast<const sockaddr&>(address.storage));
}

Error no_route(const std::string& name, int error) {
  return Error(fmt::format("no route to {}: {}", name, std::generic_category().message(error)));
}

// What this machine would send from: asked of a socket that sends nothing.
Address source_to(const Address& peer, const std::string& name) {
  const process::Fd any(socket(peer.storage.ss_family, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  Address source;
  source.bytes = sizeof source.storage;
  if (any.get() < 0 ||
      connect(any.get(), reinterpret_cast<const sockaddr*>(&peer.storage), peer.bytes) != 0 ||
      getsockname(any.get(), reinterpret_cast<sockaddr*>(&source.storage), &source.bytes) != 0)
    throw no_route(name, errno);
  return source;
}

std::string named(const std::string& address) {
  if (const auto name = interface_with(address)) return *name;
  throw Error(fmt::format("no interface of this machine has the address {}", address));
}

std::string found(const std::string& network_namespace, const std::function<std::string()>& find) {
  std::string interface;
  try {
    journal::within_namespace(network_namespace, [&] { interface = find(); });
  } catch (const journal::Error& error) {
    throw Error(error.what());
  }
  return interface;
}

}  // namespace

std::string interface_to(const std::string& peer, const std::string& network_namespace) {
  return found(network_namespace, [&] {
    const auto address = address_of(peer);
    const auto source = source_to(address, peer);
    // To itself a machine sends by way of loopback, whatever interface has the address.
    return named(numeric(source) == numeric(address) ? "127.0.0.1" : numeric(source));
  });
}

std::string interface_of(const std::string& own, const std::string& network_namespace) {
  return found(network_namespace, [&] { return named(numeric(address_of(own))); });
}

std::optional<std::string> interface_with(const std::string& wanted) {
  const auto owned = addresses();
  for (const auto* address = owned.get(); address != nullptr; address = address->ifa_next) {
    const auto* const found = address->ifa_addr;
    if (found == nullptr || (found->sa_family != AF_INET && found->sa_family != AF_INET6)) continue;
    if (numeric(*found) == wanted) return name_of(*address);
  }
  return {};
}

std::optional<int> mtu_of(const std::string& interface) {
  const process::Fd any(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  ifreq request{};
  interface.copy(request.ifr_name, sizeof request.ifr_name - 1);
  if (any.get() < 0 || ioctl(any.get(), SIOCGIFMTU, &request) != 0) return {};
  return request.ifr_mtu;
}

std::string master_of(const std::string& interface) {
  std::error_code none;
  return std::filesystem::read_symlink("/sys/class/net/" + interface + "/master", none).filename();
}

std::vector<Interface> interfaces() {
  const auto owned = addresses();
  std::vector<Interface> all;
  for (const auto* address = owned.get(); address != nullptr; address = address->ifa_next) {
    auto& interface = entry_of(all, *address);
    if (address->ifa_addr == nullptr || address->ifa_addr->sa_family != AF_INET) continue;
    interface.addresses.push_back(numeric(*address->ifa_addr));
  }
  return all;
}

std::optional<Traffic> traffic(const std::string& interface) {
  return parse_traffic(text_of("/proc/thread-self/net/dev").value_or(""), interface);
}

nlohmann::json between(const Traffic& first, const std::optional<Traffic>& last) {
  if (!last) return {{"gone", "the interface no longer exists"}};
  auto result = nlohmann::json::object();
  const std::pair<const char*, std::uint64_t Traffic::*> counters[] = {
      {"sent_bytes", &Traffic::sent_bytes},
      {"sent_packets", &Traffic::sent_packets},
      {"received_bytes", &Traffic::received_bytes},
      {"received_packets", &Traffic::received_packets}};
  for (const auto& [name, counter] : counters) {
    if ((*last).*counter < first.*counter)
      return {{"gone", "the interface's counters were set back: it is another interface of that name"}};
    result[name] = (*last).*counter - first.*counter;
  }
  return result;
}

void wait_for_counters() { std::this_thread::sleep_for(std::chrono::milliseconds(1100)); }

nlohmann::json since(const Traffic& first, const std::string& interface, std::uint64_t least_bytes,
                     const std::function<void()>& wait) {
  const auto now = traffic(interface);
  const auto enough = [&](std::uint64_t Traffic::*bytes) {
    return !now || (*now).*bytes < first.*bytes || (*now).*bytes - first.*bytes >= least_bytes;
  };
  if (enough(&Traffic::sent_bytes) && enough(&Traffic::received_bytes)) return between(first, now);
  wait();
  return between(first, traffic(interface));
}

}  // namespace ontime::machine

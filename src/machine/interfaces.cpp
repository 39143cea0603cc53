// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cerrno>
#include <memory>
#include <system_error>

#include <arpa/inet.h>
#include <fmt/format.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <netdb.h>
#include <netinet/in.h>

#include "machine/machine.hpp"

namespace ontime::machine {
namespace {

std::string dotted(const in_addr& address) {
  std::array<char, INET_ADDRSTRLEN> text{};
  return inet_ntop(AF_INET, &address, text.data(), text.size());
}

std::string name_of(const ifaddrs& address) {
  const std::string label = address.ifa_name;  // an address may have a label: eth0:1
  return label.substr(0, label.find(':'));
}

Interface& entry_of(std::vector<Interface>& all, const ifaddrs& address) {
  const auto name = name_of(address);
  const auto known =
      std::find_if(all.begin(), all.end(), [&](const Interface& one) { return one.name == name; });
  if (known != all.end()) return *known;
  const auto flags = address.ifa_flags;
  return all.emplace_back(Interface{name, "", (flags & IFF_UP) != 0, (flags & IFF_LOOPBACK) != 0});
}

using Addresses = std::unique_ptr<ifaddrs, decltype(&freeifaddrs)>;

Addresses addresses() {
  ifaddrs* first = nullptr;
  if (getifaddrs(&first) != 0)
    throw Error(fmt::format("the network interfaces of this machine cannot be listed: {}",
                            std::generic_category().message(errno)));
  return {first, freeifaddrs};
}

std::string numeric(const sockaddr& address) {
  const auto size = address.sa_family == AF_INET6 ? sizeof(sockaddr_in6) : sizeof(sockaddr_in);
  std::array<char, NI_MAXHOST> text{};
  const int failed = getnameinfo(&address, static_cast<socklen_t>(size), text.data(),
                                 static_cast<socklen_t>(text.size()), nullptr, 0, NI_NUMERICHOST);
  return failed == 0 ? text.data() : "";
}

}  // namespace

std::optional<std::string> interface_with(const std::string& wanted) {
  const auto owned = addresses();
  for (const auto* address = owned.get(); address != nullptr; address = address->ifa_next) {
    const auto* const found = address->ifa_addr;
    if (found == nullptr || (found->sa_family != AF_INET && found->sa_family != AF_INET6)) continue;
    if (numeric(*found) == wanted) return name_of(*address);
  }
  return {};
}

std::vector<Interface> interfaces() {
  const auto owned = addresses();
  std::vector<Interface> all;
  for (const auto* address = owned.get(); address != nullptr; address = address->ifa_next) {
    auto& interface = entry_of(all, *address);
    if (address->ifa_addr == nullptr || address->ifa_addr->sa_family != AF_INET) continue;
    if (interface.address.empty())
      interface.address = dotted(reinterpret_cast<const sockaddr_in*>(address->ifa_addr)->sin_addr);
  }
  return all;
}

}  // namespace ontime::machine

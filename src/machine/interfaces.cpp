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
#include <netinet/in.h>

#include "machine/machine.hpp"

namespace ontime::machine {
namespace {

std::string dotted(const in_addr& address) {
  std::array<char, INET_ADDRSTRLEN> text{};
  return inet_ntop(AF_INET, &address, text.data(), text.size());
}

Interface& entry_of(std::vector<Interface>& all, const ifaddrs& address) {
  const std::string label = address.ifa_name;  // an address may have a label: eth0:1
  const auto name = label.substr(0, label.find(':'));
  const auto known =
      std::find_if(all.begin(), all.end(), [&](const Interface& one) { return one.name == name; });
  if (known != all.end()) return *known;
  const auto flags = address.ifa_flags;
  return all.emplace_back(Interface{name, "", (flags & IFF_UP) != 0, (flags & IFF_LOOPBACK) != 0});
}

}  // namespace

std::vector<Interface> interfaces() {
  ifaddrs* first = nullptr;
  if (getifaddrs(&first) != 0)
    throw Error(fmt::format("the network interfaces of this machine cannot be listed: {}",
                            std::generic_category().message(errno)));
  const std::unique_ptr<ifaddrs, decltype(&freeifaddrs)> owned(first, freeifaddrs);
  std::vector<Interface> all;
  for (const auto* address = first; address != nullptr; address = address->ifa_next) {
    auto& interface = entry_of(all, *address);
    if (address->ifa_addr == nullptr || address->ifa_addr->sa_family != AF_INET) continue;
    if (interface.address.empty())
      interface.address = dotted(reinterpret_cast<const sockaddr_in*>(address->ifa_addr)->sin_addr);
  }
  return all;
}

}  // namespace ontime::machine

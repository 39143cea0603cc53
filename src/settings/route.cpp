// SPDX-License-Identifier: Apache-2.0
// Which interface the traffic takes: by the kernel's own choice of a route, not by a name.
#include <array>
#include <cerrno>
#include <functional>
#include <memory>

#include <fmt/format.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <netdb.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include "settings/file.hpp"
#include "settings/settings.hpp"

namespace ontime::settings {
namespace {

struct Address {
  sockaddr_storage storage{};
  socklen_t bytes = 0;
};

Address address_of(const std::string& name) {
  addrinfo hints{};
  hints.ai_socktype = SOCK_DGRAM;
  addrinfo* found = nullptr;
  if (const int error = getaddrinfo(name.c_str(), "9", &hints, &found); error != 0)
    throw journal::Error(fmt::format("'{}' is no address: {}", name, gai_strerror(error)));
  const std::unique_ptr<addrinfo, decltype(&freeaddrinfo)> owned(found, freeaddrinfo);
  Address address;
  address.bytes = owned->ai_addrlen;
  std::copy_n(reinterpret_cast<const char*>(owned->ai_addr), address.bytes,
              reinterpret_cast<char*>(&address.storage));
  return address;
}

std::string text_of(const sockaddr* address) {
  std::array<char, NI_MAXHOST> text{};
  const auto bytes = address->sa_family == AF_INET ? sizeof(sockaddr_in) : sizeof(sockaddr_in6);
  if (getnameinfo(address, static_cast<socklen_t>(bytes), text.data(), text.size(), nullptr, 0,
                  NI_NUMERICHOST) != 0)
    return "";
  return text.data();
}

std::string text_of(const Address& address) {
  return text_of(reinterpret_cast<const sockaddr*>(&address.storage));
}

// What this machine would send from: asked of a socket that sends nothing.
Address source_to(const Address& peer, const std::string& name) {
  const int any = socket(peer.storage.ss_family, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (any < 0) throw trouble("a route to " + name, errno);
  Address source;
  source.bytes = sizeof source.storage;
  const bool known = connect(any, reinterpret_cast<const sockaddr*>(&peer.storage), peer.bytes) == 0 &&
                     getsockname(any, reinterpret_cast<sockaddr*>(&source.storage), &source.bytes) == 0;
  const int error = errno;
  close(any);
  if (!known) throw trouble("a route to " + name, error);
  return source;
}

std::string interface_of(const std::string& address) {
  ifaddrs* first = nullptr;
  if (getifaddrs(&first) != 0) throw trouble("the interfaces of this machine", errno);
  const std::unique_ptr<ifaddrs, decltype(&freeifaddrs)> owned(first, freeifaddrs);
  for (const auto* one = first; one != nullptr; one = one->ifa_next) {
    const auto* const own = one->ifa_addr;
    if (own == nullptr || (own->sa_family != AF_INET && own->sa_family != AF_INET6)) continue;
    const std::string label = one->ifa_name;  // an address may have a label: eth0:1
    if (text_of(own) == address) return label.substr(0, label.find(':'));
  }
  throw journal::Error(fmt::format("no interface of this machine has the address {}", address));
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
    return text_of(source) == text_of(address) ? interface_of("127.0.0.1") : interface_of(text_of(source));
  });
}

std::string interface_with(const std::string& address, const std::string& network_namespace) {
  return found(network_namespace, [&] { return interface_of(text_of(address_of(address))); });
}

}  // namespace ontime::settings

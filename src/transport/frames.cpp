// SPDX-License-Identifier: Apache-2.0
#include "transport/frames.hpp"

#include <memory>
#include <optional>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <ifaddrs.h>
#include <net/if_arp.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

namespace ontime::transport::frames {
namespace {

// What the kernel reports about an interface, through any socket.
std::optional<ifreq> asked(const std::string& name, unsigned long what) {
  const Descriptor any(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  ifreq request{};
  name.copy(request.ifr_name, sizeof request.ifr_name - 1);
  if (any < 0 || ioctl(any, what, &request) != 0) return {};
  return request;
}

std::optional<unsigned> flags_of(const std::string& name) {
  if (const auto found = asked(name, SIOCGIFFLAGS)) return static_cast<unsigned short>(found->ifr_flags);
  return {};
}

std::vector<in_addr_t> addresses_of(const std::string& name) {
  std::vector<in_addr_t> found;
  ifaddrs* list = nullptr;
  if (getifaddrs(&list) != 0) return found;
  const std::unique_ptr<ifaddrs, decltype(&freeifaddrs)> owner(list, freeifaddrs);
  for (const ifaddrs* entry = list; entry != nullptr; entry = entry->ifa_next)
    if (entry->ifa_name == name && entry->ifa_addr != nullptr && entry->ifa_addr->sa_family == AF_INET)
      found.push_back(reinterpret_cast<const sockaddr_in*>(entry->ifa_addr)->sin_addr.s_addr);
  return found;
}

std::size_t frame_bytes_of(const Config& config, const std::string& who, std::size_t most_bytes,
                           std::size_t mtu) {
  const std::size_t most = std::min(mtu + ethernet_bytes, most_bytes);
  if (most < overhead) throw Error(fmt::format("{}: the MTU of {} is {}", who, config.interface, mtu));
  if (config.role == Role::server && config.max_payload_bytes == 0) return most;
  const std::size_t needed = overhead + config.max_payload_bytes;
  if (needed <= most) return needed;
  throw Error(fmt::format(
      "{}: a payload of {} bytes is too large for one frame of {} ({} bytes at most); {} does not split "
      "messages{}",
      who, config.max_payload_bytes, config.interface, most - overhead, who,
      mtu + ethernet_bytes <= most_bytes
          ? fmt::format(". It has an MTU of {}. Fix: sudo ip link set {} mtu N, at both ends", mtu,
                        config.interface)
          : ""));
}

std::uint64_t hash(int domain, const std::string& topic) {
  std::uint64_t value = 0xcbf29ce484222325;  // FNV-1a
  for (const char letter : std::to_string(domain) + topic)
    value = (value ^ static_cast<unsigned char>(letter)) * 0x100000001b3;
  return value;
}

}  // namespace

Link link_of(const Config& config, const std::string& who, std::size_t most_bytes) {
  if (config.interface.empty())
    throw WrongInput("an interface is needed. Fix: --interface, or `interface` of both hosts");
  if (config.ping_topic == config.pong_topic)
    throw WrongInput(fmt::format("{}: ping and pong have the same topic, {}. Fix: set two different topics",
                                 who, config.ping_topic));
  if (config.interface.size() >= IFNAMSIZ)
    throw WrongInput(fmt::format("{}: '{}' is too long for an interface name", who, config.interface));
  await_running([&] { return flags_of(config.interface); }, who, config.interface, " (see ip link)");
  Link link{.name = config.interface, .addresses = addresses_of(config.interface)};
  if (const auto found = asked(config.interface, SIOCGIFINDEX)) link.index = found->ifr_ifindex;
  if (const auto found = asked(config.interface, SIOCGIFHWADDR)) {
    const auto kind = found->ifr_hwaddr.sa_family;
    link.loopback = kind == ARPHRD_LOOPBACK;
    if (kind != ARPHRD_ETHER && !link.loopback)
      throw Error(fmt::format(
          "{}: interface {} is not Ethernet (kernel type {}). Fix: name one that `ip link` shows as "
          "link/ether",
          who, config.interface, kind));
    std::memcpy(link.mac.data(), found->ifr_hwaddr.sa_data, link.mac.size());
  }
  const auto mtu = asked(config.interface, SIOCGIFMTU);
  if (link.index == 0 || !mtu)
    throw Error(fmt::format("{}: interface {} no longer exists", who, config.interface));
  link.frame_bytes = frame_bytes_of(config, who, most_bytes, static_cast<std::size_t>(mtu->ifr_mtu));
  return link;
}

std::uint64_t topic_written(const Config& config) {
  return hash(config.domain, config.role == Role::client ? config.ping_topic : config.pong_topic);
}
std::uint64_t topic_read(const Config& config) {
  return hash(config.domain, config.role == Role::client ? config.pong_topic : config.ping_topic);
}

in_addr_t wanted(const Config& config, const std::string& who) {
  if (config.role == Role::server || config.peers.empty()) return 0;
  const std::string host = config.peers.front().substr(0, config.peers.front().rfind(':'));
  in_addr address{};
  if (const int code = look_up(host, address); code != 0)
    throw Error(
        fmt::format("{}: host '{}' not found: {}. Fix: state an IPv4 address of pong's interface, or no peer",
                    who, host, gai_strerror(code)));
  return address.s_addr;
}

bool busy_polls(const Config& config, const std::string& who) {
  const auto option = config.options.find("busy-poll");
  if (option == config.options.end() || option->second == "off") return false;
  if (option->second == "on") return true;
  throw WrongInput(fmt::format("{}: option busy-poll: '{}' is not on or off", who, option->second));
}

std::string text_of(const Mac& mac) { return fmt::format("{:02x}", fmt::join(mac, ":")); }

Bell::Bell() : fd_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
  if (fd_ < 0) throw Error("no eventfd: " + errno_text());
}

void Bell::ring() noexcept {
  rung_ = true;
  eventfd_write(fd_, 1);
}

int Bell::wait(int fd) const noexcept {
  std::array<pollfd, 2> both{{{fd, POLLIN, 0}, {fd_, POLLIN, 0}}};
  if (poll(both.data(), both.size(), -1) <= 0 || (both[0].revents & POLLERR) == 0) return 0;
  int error = 0;
  socklen_t length = sizeof error;
  getsockopt(fd, SOL_SOCKET, SO_ERROR, &error, &length);
  return error;
}

}  // namespace ontime::transport::frames

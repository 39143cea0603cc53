// SPDX-License-Identifier: Apache-2.0
#include "listen/packets.hpp"

#include <algorithm>
#include <cstdlib>

#include <arpa/inet.h>
#include <fmt/format.h>
#include <net/if_arp.h>
#include <netinet/in.h>
#include <pcap/dlt.h>
#include <pcap/sll.h>

#include "listen/listen.hpp"

namespace ontime::listen {
namespace {

using Bytes = std::span<const std::byte>;

constexpr std::size_t most_partial = 64, most_datagram_bytes = 65535, block_bytes = 8;
// As Linux: identifications come again, at 1,000 datagrams a second after 66 s.
constexpr std::int64_t longest_partial_ns = 30'000'000'000;
constexpr std::array rtps_begin{std::byte{'R'}, std::byte{'T'}, std::byte{'P'}, std::byte{'S'}};
constexpr std::uint16_t ethertype_ipv4 = 0x0800, ethertype_ipv6 = 0x86dd, ethertype_vlan = 0x8100,
                        ethertype_service_vlan = 0x88a8;

std::uint32_t number(Bytes bytes, std::size_t at, std::size_t size) {
  std::uint32_t value = 0;
  for (std::size_t i = at; i < at + size; ++i) value = value << 8U | std::to_integer<std::uint32_t>(bytes[i]);
  return value;
}

std::string address_of(int family, Bytes address, std::uint32_t port) {
  char text[INET6_ADDRSTRLEN] = {};
  inet_ntop(family, address.data(), text, sizeof text);
  return family == AF_INET ? fmt::format("{}:{}", text, port) : fmt::format("[{}]:{}", text, port);
}

// `is_cut`: the IP packet was.
std::optional<Datagram> udp(int family, Bytes source, Bytes destination, Bytes bytes, bool is_cut) {
  if (bytes.size() < 8) return {};
  const std::size_t size = number(bytes, 4, 2);
  if (size < 8) return {};
  const auto payload = bytes.subspan(8, std::min(size, bytes.size()) - 8);
  const auto begin = payload.first(std::min(payload.size(), rtps_begin.size()));
  const bool may_be_rtps = std::equal(begin.begin(), begin.end(), rtps_begin.begin());
  const bool is_loopback = family == AF_INET && source[0] == std::byte{127};
  return Datagram{.source = address_of(family, source, number(bytes, 0, 2)),
                  .destination = address_of(family, destination, number(bytes, 2, 2)),
                  .is_one_host = is_loopback || std::equal(source.begin(), source.end(), destination.begin()),
                  .is_cut = (is_cut || size > bytes.size()) && may_be_rtps,
                  .payload = payload};
}

}  // namespace

Packets::Packets(int link_type) : link_type_(link_type) {
  for (const int known : {DLT_EN10MB, DLT_LINUX_SLL, DLT_LINUX_SLL2, DLT_RAW})
    if (link_type == known) return;
  throw Error(fmt::format(
      "link type {} is not supported; supported: Ethernet (1), raw IP (12), Linux cooked (113, 276)",
      link_type));
}

std::optional<Datagram> Packets::datagram(std::span<const std::byte> frame, std::int64_t at_ns) {
  at_ns_ = at_ns;
  std::uint32_t type = 0, interface = 0;
  std::size_t header = 0;
  if (link_type_ == DLT_EN10MB) {
    header = 14;
    if (frame.size() < header) return {};
    type = number(frame, 12, 2);
  } else if (link_type_ == DLT_LINUX_SLL || link_type_ == DLT_LINUX_SLL2) {
    const bool is_second = link_type_ == DLT_LINUX_SLL2;
    header = is_second ? 20 : 16;
    if (frame.size() < header) return {};
    type = number(frame, is_second ? 0 : 14, 2);
    interface = is_second ? number(frame, 4, 4) : 0;
    const auto direction = is_second ? number(frame, 10, 1) : number(frame, 0, 2);
    const auto device = is_second ? number(frame, 8, 2) : number(frame, 2, 2);
    if (device == ARPHRD_LOOPBACK && direction == LINUX_SLL_OUTGOING) return {};
  } else {
    if (frame.empty()) return {};
    type = std::to_integer<unsigned>(frame[0]) >> 4U == 6 ? ethertype_ipv6 : ethertype_ipv4;
  }
  for (int tags = 0; tags < 2 && (type == ethertype_vlan || type == ethertype_service_vlan); ++tags) {
    if (frame.size() < header + 4) return {};
    type = number(frame, header + 2, 2);
    header += 4;
  }
  std::optional<Datagram> found;
  if (type == ethertype_ipv4) found = ipv4(frame.subspan(header));
  if (type == ethertype_ipv6) found = ipv6(frame.subspan(header));
  if (found) found->interface = interface;
  return found;
}

std::optional<Datagram> Packets::ipv4(Bytes packet) {
  if (packet.size() < 20) return {};
  const std::size_t header = std::size_t{number(packet, 0, 1) & 0xfU} * 4, size = number(packet, 2, 2);
  if (header < 20 || size < header || packet.size() < header || number(packet, 9, 1) != IPPROTO_UDP)
    return {};
  auto bytes = packet.subspan(header, std::min(size, packet.size()) - header);
  const auto flags = number(packet, 6, 2);
  const std::size_t at = std::size_t{flags & 0x1fffU} * 8;
  const bool is_last = (flags & 0x2000U) == 0;
  // The first fragment is no shorter than the others: where it is whole, they are.
  const bool is_cut = size > packet.size() && at == 0;
  if (!is_cut && (at > 0 || !is_last)) {
    const auto all =
        whole(packet.subspan(12, 4), packet.subspan(16, 4), number(packet, 4, 2), at, is_last, bytes);
    if (!all) return {};
    bytes = *all;
  }
  return udp(AF_INET, packet.subspan(12, 4), packet.subspan(16, 4), bytes, is_cut);
}

std::optional<Datagram> Packets::ipv6(Bytes packet) {
  if (packet.size() < 40) return {};
  const auto source = packet.subspan(8, 16), destination = packet.subspan(24, 16);
  const auto next = number(packet, 6, 1);
  // Ethernet may pad the frame: the packet says how long it is.
  const std::size_t size = number(packet, 4, 2);
  const bool is_cut = size > packet.size() - 40;
  const auto bytes = packet.subspan(40, std::min(size, packet.size() - 40));
  if (next == IPPROTO_UDP) return udp(AF_INET6, source, destination, bytes, is_cut);
  if (next != IPPROTO_FRAGMENT || bytes.size() < 8 || number(bytes, 0, 1) != IPPROTO_UDP) return {};
  const auto flags = number(bytes, 2, 2);
  if (is_cut && (flags & 0xfff8U) == 0) return udp(AF_INET6, source, destination, bytes.subspan(8), is_cut);
  const auto all =
      whole(source, destination, number(bytes, 4, 4), flags & 0xfff8U, (flags & 1U) == 0, bytes.subspan(8));
  if (!all) return {};
  return udp(AF_INET6, source, destination, *all, false);
}

// The datagram, when all of its fragments arrived. Overlapping fragments only make one that is not RTPS.
std::optional<Packets::Bytes> Packets::whole(Bytes source, Bytes destination, std::uint32_t identification,
                                             std::size_t at, bool is_last, Bytes piece) {
  const auto end = at + piece.size();
  if (end > most_datagram_bytes || (!is_last && end % block_bytes != 0)) return {};
  Key key{{}, {}, identification};
  std::copy(source.begin(), source.end(), std::get<0>(key).begin());
  std::copy(destination.begin(), destination.end(), std::get<1>(key).begin());
  const auto [found, is_new] = partial_.try_emplace(key);
  if (is_new) {
    oldest_.push_back(key);
    if (oldest_.size() > most_partial) {
      partial_.erase(oldest_.front());
      oldest_.pop_front();
    }
  }
  auto& partial = found->second;
  if (std::abs(at_ns_ - partial.begun_ns) > longest_partial_ns) {
    partial = Partial();
    partial.begun_ns = at_ns_;
  }
  if (partial.bytes.size() < end) partial.bytes.resize(end);
  std::copy(piece.begin(), piece.end(), partial.bytes.begin() + static_cast<std::ptrdiff_t>(at));
  for (auto block = at / block_bytes; block * block_bytes < end; ++block) partial.blocks.set(block);
  if (is_last) partial.total = end;
  if (!partial.total) return {};
  for (std::size_t block = 0; block * block_bytes < *partial.total; ++block)
    if (!partial.blocks.test(block)) return {};
  put_together_ = std::move(partial.bytes);
  put_together_.resize(*partial.total);
  partial_.erase(found);
  std::erase(oldest_, key);
  return put_together_;
}

}  // namespace ontime::listen

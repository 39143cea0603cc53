// SPDX-License-Identifier: Apache-2.0
// Captured frames become UDP datagrams; IPv4 fragments are put together. Any bytes are valid input; memory is
// bounded.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <tuple>
#include <vector>

namespace ontime::listen {

struct Datagram {
  std::string source, destination;     // "192.168.1.2:7410", "[fe80::1]:7400"
  bool is_one_host = false;            // it goes from an address to the same address, or over loopback
  std::span<const std::byte> payload;  // valid until the next call
};

class Packets {
 public:
  // Of a link type of libpcap (DLT_…) other than those that are understood, throws Error.
  explicit Packets(int link_type);
  // Empty: no UDP datagram ends with this frame, or it is the sending half of one on loopback, which shows it
  // twice.
  std::optional<Datagram> datagram(std::span<const std::byte> frame);

 private:
  using Bytes = std::span<const std::byte>;
  using Key = std::tuple<std::uint32_t, std::uint32_t, std::uint16_t>;  // source, destination, identification
  struct Partial {
    std::vector<std::byte> bytes;
    std::size_t have = 0;
    std::optional<std::size_t> total;
  };
  std::optional<Datagram> ipv4(Bytes packet);
  static std::optional<Datagram> ipv6(Bytes packet);
  std::optional<Bytes> whole(const Key&, std::size_t at, bool is_last, Bytes piece);

  const int link_type_;
  std::map<Key, Partial> partial_;
  std::deque<Key> oldest_;  // of partial_, in order of arrival
  std::vector<std::byte> put_together_;
};

}  // namespace ontime::listen

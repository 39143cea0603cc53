// SPDX-License-Identifier: Apache-2.0
// Captured frames become UDP datagrams; IP fragments are put together. Any bytes are valid input; memory is
// bounded.
#pragma once

#include <array>
#include <bitset>
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
  std::uint32_t interface = 0;         // that it passed, where the capture tells
  bool is_one_host = false;            // it goes from an address to the same address, or over loopback
  bool is_cut = false;                 // it may be RTPS, and the capture kept less of it than it had
  std::span<const std::byte> payload;  // valid until the next call
};

class Packets {
 public:
  // Throws Error for an unsupported link type of libpcap (DLT_…).
  explicit Packets(int link_type);
  // Empty: no UDP datagram ends with this frame, or it is the sending half of one on loopback, which shows it
  // twice.
  std::optional<Datagram> datagram(std::span<const std::byte> frame, std::int64_t at_ns = 0);

 private:
  using Bytes = std::span<const std::byte>;
  using Address = std::array<std::byte, 16>;
  using Key = std::tuple<Address, Address, std::uint32_t>;  // source, destination, identification
  struct Partial {
    std::vector<std::byte> bytes;
    std::bitset<8192> blocks;  // of eight bytes, that were here
    std::optional<std::size_t> total;
    std::int64_t begun_ns = 0;
  };
  std::optional<Datagram> ipv4(Bytes packet);
  std::optional<Datagram> ipv6(Bytes packet);
  std::optional<Bytes> whole(Bytes source, Bytes destination, std::uint32_t identification, std::size_t at,
                             bool is_last, Bytes piece);

  const int link_type_;
  std::int64_t at_ns_ = 0;  // of the frame
  std::map<Key, Partial> partial_;
  std::deque<Key> oldest_;  // of partial_, in order of arrival
  std::vector<std::byte> put_together_;
};

}  // namespace ontime::listen

// SPDX-License-Identifier: Apache-2.0
// RTPS datagrams made by hand.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <initializer_list>
#include <string>
#include <vector>

#include "listen/rtps.hpp"

namespace ontime::listen {

using Bytes = std::vector<std::byte>;

inline void add(Bytes& bytes, std::initializer_list<unsigned> values) {
  for (const auto value : values) bytes.push_back(static_cast<std::byte>(value));
}
inline void add_little(Bytes& bytes, std::uint64_t value, std::size_t size) {
  for (std::size_t i = 0; i < size; ++i) bytes.push_back(static_cast<std::byte>(value >> (8 * i)));
}
inline void add_sequence(Bytes& bytes, std::uint64_t number) {
  add_little(bytes, number >> 32U, 4);
  add_little(bytes, number, 4);
}

inline constexpr std::array<unsigned, 4> user_writer{0, 0, 0x12, 0x03}, user_reader{0, 0, 0x13, 0x04},
    publications{0, 0, 0x03, 0xc2}, subscriptions{0, 0, 0x04, 0xc2};

class Rtps {
 public:
  Rtps() { add(bytes, {'R', 'T', 'P', 'S', 2, 1, 1, 0x10, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12}); }
  Rtps& stamp(std::uint32_t seconds, std::uint32_t fraction) {
    Bytes body;
    add_little(body, seconds, 4);
    add_little(body, fraction, 4);
    return submessage(0x09, 1, body);
  }
  Rtps& data(std::uint64_t number, const Bytes& payload = {}, std::array<unsigned, 4> writer = user_writer) {
    Bytes body;
    add(body, {0, 0, 16, 0, 0, 0, 0, 0, writer[0], writer[1], writer[2], writer[3]});
    add_sequence(body, number);
    body.insert(body.end(), payload.begin(), payload.end());
    return submessage(0x15, 5, body);
  }
  Rtps& key(std::uint64_t number) {  // an instance ends
    Bytes body;
    add(body, {0, 0, 16, 0, 0, 0, 0, 0, 0, 0, 0x12, 0x03});
    add_sequence(body, number);
    return submessage(0x15, 9, body);
  }
  // Of 1000 bytes each. Only so many are there.
  Rtps& fragment(std::uint64_t number, unsigned first, unsigned count, unsigned total) {
    return fragment(number, first, count, total, std::size_t{1000} * count);
  }
  Rtps& fragment(std::uint64_t number, unsigned first, unsigned count, unsigned total, std::size_t there) {
    Bytes body;
    add(body, {0, 0, 28, 0, 0, 0, 0, 0, 0, 0, 0x12, 0x03});
    add_sequence(body, number);
    add_little(body, first, 4);
    add_little(body, count, 2);
    add_little(body, 1000, 2);
    add_little(body, total * 1000, 4);
    body.resize(body.size() + there);
    return submessage(0x16, 1, body);
  }
  Rtps& gap(std::uint64_t first, std::uint64_t base, unsigned bits, std::uint32_t word) {
    Bytes body;
    add(body, {0, 0, 0, 0, 0, 0, 0x12, 0x03});
    add_sequence(body, first);
    add_sequence(body, base);
    add_little(body, bits, 4);
    if (bits > 0) add_little(body, word, 4);
    return submessage(0x08, 1, body);
  }
  Rtps& heartbeat(std::uint64_t first, std::uint64_t last) {
    Bytes body;
    add(body, {0, 0, 0, 0, 0, 0, 0x12, 0x03});
    add_sequence(body, first);
    add_sequence(body, last);
    add_little(body, 1, 4);
    return submessage(0x07, 1, body);
  }
  // Discovery of the user's writer, or of a reader.
  Rtps& announce(const std::string& topic) { return announce(topic, user_writer, publications); }
  Rtps& announce_reader(const std::string& topic, unsigned number = 0) {
    return announce(topic, {number >> 8U, number & 255U, user_reader[2], user_reader[3]}, subscriptions);
  }
  Rtps& announce(const std::string& topic, std::array<unsigned, 4> endpoint, std::array<unsigned, 4> by) {
    Bytes list;
    add(list, {0, 3, 0, 0});
    add_little(list, 0x5a, 2);
    add_little(list, 16, 2);
    add(list, {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12});
    add(list, {endpoint[0], endpoint[1], endpoint[2], endpoint[3]});
    const auto size = topic.size() + 1, padded = (size + 3) / 4 * 4;
    add_little(list, 5, 2);
    add_little(list, 4 + padded, 2);
    add_little(list, size, 4);
    for (std::size_t i = 0; i < padded; ++i)
      list.push_back(static_cast<std::byte>(i < topic.size() ? topic[i] : 0));
    add(list, {1, 0, 0, 0});
    return data(1, list, by);
  }
  Rtps& submessage(unsigned kind, unsigned flags, const Bytes& body) {
    add(bytes, {kind, flags});
    add_little(bytes, body.size(), 2);
    bytes.insert(bytes.end(), body.begin(), body.end());
    return *this;
  }
  Bytes bytes;
};

}  // namespace ontime::listen

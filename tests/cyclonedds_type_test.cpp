// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <vector>

#include <dds/ddsi/q_radmin.h>
#include <gtest/gtest.h>

#include "message/message.hpp"
#include "transport/cyclonedds/cdr_type.hpp"

namespace ontime::transport::cyclonedds {
namespace {

constexpr std::uint16_t payload_begins = 64;

// What came from the network: a datagram, and what of a message it is said to hold.
struct Datagram {
  Datagram(std::uint32_t min, std::uint32_t end, std::byte fill) {
    bytes.fill(fill);
    fragment.rmsg = &message;
    fragment.min = min;
    fragment.maxp1 = end;
    fragment.payload_zoff = payload_begins;
  }
  nn_rmsg message{};
  std::array<std::byte, 2048> bytes;  // Cyclone has them behind what it knows of them
  nn_rdata fragment{};
};

// Cyclone takes a message for whole whose last fragment reaches beyond the size that the first one named, and
// leaves it to the type to cut it.
TEST(CycloneType, WhatReachesBeyondAMessageIsCutOff) {
  constexpr std::size_t payload_bytes = 48, size = 40;
  Blocks blocks(message::cdr_overhead + payload_bytes);
  auto* const type = new_type(blocks);
  const std::vector<std::byte> payload(payload_bytes, std::byte{7});
  auto* const first = new_message(*type, 1, payload);
  auto* const background = new_message(*type, 2, payload);
  const std::vector before(cdr(*background).begin(), cdr(*background).end());
  ddsi_serdata_unref(first);  // whose block is the next to be used

  Datagram begin(0, 30, std::byte{1}), end(30, 1000, std::byte{2});
  begin.fragment.nextfrag = &end.fragment;
  auto* const forged = type->serdata_ops->from_ser(type, SDK_DATA, &begin.fragment, size);
  ASSERT_NE(forged, nullptr);
  const auto received = cdr(*forged);
  ASSERT_EQ(received.size(), size);
  EXPECT_EQ(std::count(received.begin(), received.end(), std::byte{1}), 30);
  EXPECT_EQ(std::count(received.begin(), received.end(), std::byte{2}), 10);
  EXPECT_TRUE(std::equal(before.begin(), before.end(), cdr(*background).begin(), cdr(*background).end()));

  ddsi_serdata_unref(forged);
  ddsi_serdata_unref(background);
  ddsi_sertype_unref(type);
}

}  // namespace
}  // namespace ontime::transport::cyclonedds

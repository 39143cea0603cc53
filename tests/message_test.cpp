// SPDX-License-Identifier: Apache-2.0
#include "message/message.hpp"

#include <limits>
#include <random>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace ontime::message {
namespace {

std::vector<std::byte> bytes(std::initializer_list<int> values) {
  std::vector<std::byte> result;
  for (const int value : values) result.push_back(static_cast<std::byte>(value));
  return result;
}

TEST(Cdr, IsWhatRos2WritesForTheSameMessage) {
  std::vector<std::byte> cdr(cdr_overhead + 3);
  ASSERT_EQ(encode(0x0102030405060708, bytes({0xaa, 0xbb, 0xcc}), cdr), cdr.size());
  EXPECT_EQ(cdr, bytes({0, 1, 0, 0, 8, 7, 6, 5, 4, 3, 2, 1, 3, 0, 0, 0, 0xaa, 0xbb, 0xcc}));
}

TEST(Cdr, IsReadInEitherByteOrderAndWithPaddingBehind) {
  auto big = bytes({0, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 0, 0, 0, 1, 0xaa, 0, 0, 0});
  const auto view = decode(big);
  ASSERT_TRUE(view);
  EXPECT_EQ(view->sequence, 0x0102030405060708);
  EXPECT_THAT(view->payload, testing::ElementsAre(std::byte{0xaa}));
}

TEST(Cdr, EncodedMessageIsDecoded) {
  std::mt19937_64 random(1);
  for (int round = 0; round < 500; ++round) {
    std::vector<std::byte> payload(random() % 2000);
    for (auto& byte : payload) byte = static_cast<std::byte>(random());
    const auto sequence = random();
    std::vector<std::byte> cdr(cdr_overhead + payload.size());
    encode(sequence, payload, cdr);
    const auto view = decode(cdr);
    ASSERT_TRUE(view);
    EXPECT_EQ(view->sequence, sequence);
    EXPECT_THAT(view->payload, testing::ElementsAreArray(payload));
  }
}

TEST(Cdr, BytesThatAreNoMessageGiveNothing) {
  std::vector<std::byte> cdr(cdr_overhead + 8);
  encode(1, std::vector<std::byte>(8), cdr);
  for (std::size_t length = 0; length < cdr.size(); ++length) {
    std::vector<std::byte> cut(cdr.begin(), cdr.begin() + static_cast<std::ptrdiff_t>(length));
    EXPECT_FALSE(decode(cut)) << length;
  }
  cdr[1] = std::byte{7};  // XCDR2
  EXPECT_FALSE(decode(cdr));
}

TEST(Cdr, RandomBytesNeverReadBeyondTheirEnd) {
  std::mt19937 random(2);
  for (int round = 0; round < 20000; ++round) {
    std::vector<std::byte> noise(random() % 40);
    for (auto& byte : noise) byte = static_cast<std::byte>(random() % 3);
    const auto view = decode(noise);
    EXPECT_LE(view ? view->payload.size() + cdr_overhead : 0, noise.size());
  }
}

TEST(Sequence, KeepsSessionAndIndexApart) {
  const auto sequence = sequence_of(0xabcdef, max_index);
  EXPECT_EQ(session_of(sequence), 0xabcdefU);
  EXPECT_EQ(warm_up_session_of(0xabcdef), 0xabcdf0U);
  EXPECT_EQ(warm_up_session_of(0xffffff), 0U);
  EXPECT_EQ(index_of(sequence), max_index);
  EXPECT_EQ(index_of(sequence_of(1, max_index + 1)), 0U);
}

TEST(ServerTimes, AreNotBelievedWhereNoClockCanShowThem) {
  constexpr std::int64_t least = std::numeric_limits<std::int64_t>::min(),
                         most = std::numeric_limits<std::int64_t>::max();
  std::vector<std::byte> payload(server_times_bytes);
  for (const auto& times :
       {ServerTimes{-1, 5}, {0, 5}, {7, 5}, {5, 0}, {least, most}, {most, most}, {5, most}}) {
    put_server_times(payload, times);
    EXPECT_FALSE(server_times(payload)) << times.received_ns << ' ' << times.sent_ns;
  }
}

TEST(ServerTimes, TravelInPayloadsThatHaveRoom) {
  std::vector<std::byte> payload(server_times_bytes);
  EXPECT_FALSE(server_times(payload)) << "an end that only echoes leaves zeros";
  put_server_times(payload, {5, 7});
  const auto times = server_times(payload);
  ASSERT_TRUE(times);
  EXPECT_EQ(times->received_ns, 5);
  EXPECT_EQ(times->sent_ns, 7);
  std::vector<std::byte> small(server_times_bytes - 1);
  put_server_times(small, {5, 7});
  EXPECT_FALSE(server_times(small));
  EXPECT_THAT(small, testing::Each(std::byte{0}));
}

}  // namespace
}  // namespace ontime::message

// SPDX-License-Identifier: Apache-2.0
#include <limits>
#include <random>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "campaign/campaign.hpp"

namespace ontime::campaign {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;

TEST(Quantity, IsANumberWithAUnit) {
  EXPECT_EQ(duration_of("10 ms"), 10ms);
  EXPECT_EQ(duration_of("10ms"), 10ms);
  EXPECT_EQ(duration_of("0.5 s"), 500ms);
  EXPECT_EQ(duration_of("250 µs"), 250us);
  EXPECT_EQ(duration_of("250 us"), 250us);
  EXPECT_EQ(duration_of("12 h"), 12h);
  for (const auto* text : {"1 s", "1500 ms", "90 min", "2 h", "10 ms", "250 µs", "7 ns", "0 ns"})
    EXPECT_EQ(text_of(duration_of(text)), text);
  EXPECT_EQ(bytes_of("500 B"), 500U);
  EXPECT_EQ(bytes_of("32 KiB"), 32768U);
  EXPECT_EQ(bytes_of("1 MB"), 1'000'000U);
}

TEST(Quantity, InvalidTextIsRefused) {
  for (const auto* text :
       {"",        "ten",     "ms",         "10",      "10 parsec", "10 ms more",    "nan s",
        "-nan s",  "inf s",   "infinity s", "1e300 s", "1e-5000 s", "99999999999 h", "-99999999999 h",
        "0x10 ms", "0x1p3 s", "+5 ms",      "- 5 ms",  "1,5 ms",    " 10 ms",        "10 ms ",
        "10\tms",  "10 MS",   "1_000 ms",   "10 ms 5", "١٠ ms"})
    EXPECT_THROW(duration_of(text), std::invalid_argument) << text;
  for (const auto* text : {"500", "-1 B", "0.5 B", "1e30 B", "99999999999 GiB", "nan B", "inf kB", "0x10 B",
                           "1 kb", "1 K", "+1 B", "1 B/s", "0.0005 B", "1.00055 kB", "0.0000000005 GB"})
    EXPECT_THROW(bytes_of(text), std::invalid_argument) << text;
  try {
    duration_of("10");
    FAIL();
  } catch (const std::invalid_argument& error) {
    EXPECT_THAT(error.what(), HasSubstr("10 ms"));
  }
}

// Whatever is written in whole units, or in thousandths of the next, is what is read: nothing is rounded
// away.
TEST(Quantity, IsReadExactly) {
  const std::vector<std::pair<std::string, std::int64_t>> times{{"ns", 1},
                                                                {"us", 1'000},
                                                                {"µs", 1'000},
                                                                {"ms", 1'000'000},
                                                                {"s", 1'000'000'000},
                                                                {"min", 60'000'000'000},
                                                                {"h", 3'600'000'000'000}};
  const std::vector<std::pair<std::string, std::uint64_t>> sizes{
      {"B", 1},           {"kB", 1'000},         {"KiB", 1U << 10U}, {"MB", 1'000'000},
      {"MiB", 1U << 20U}, {"GB", 1'000'000'000}, {"GiB", 1U << 30U}};
  constexpr std::int64_t most = 9'000'000'000'000'000'000;
  std::mt19937_64 random(5);
  // Of all magnitudes alike.
  const auto up_to = [&](std::int64_t limit) {
    return static_cast<std::int64_t>(random() >> (1 + random() % 62)) % (limit + 1);
  };
  for (int round = 0; round < 2000; ++round) {
    const auto blank = random() % 2 == 0 ? " " : "";
    for (const auto& [unit, factor] : times) {
      const auto count = up_to(most / factor) * (random() % 2 == 0 ? 1 : -1);
      const auto text = std::to_string(count) + blank + unit;
      ASSERT_EQ(duration_of(text).count(), count * factor) << text;
    }
    for (const auto& [unit, factor] : sizes) {
      const auto count = static_cast<std::uint64_t>(up_to(most / static_cast<std::int64_t>(factor)));
      const auto text = std::to_string(count) + blank + unit;
      ASSERT_EQ(bytes_of(text), count * factor) << text;
    }
    const auto thousandths = up_to(1'000'000'000);
    const auto digits = std::to_string(1000 + thousandths % 1000).substr(1);
    const auto text = std::to_string(thousandths / 1000) + "." + digits + " s";
    ASSERT_EQ(duration_of(text).count(), thousandths * 1'000'000) << text;
    for (const auto& [unit, factor] : sizes)
      if (factor % 1000 == 0) {
        const auto size = std::to_string(thousandths / 1000) + "." + digits + unit;
        ASSERT_EQ(bytes_of(size), static_cast<std::uint64_t>(thousandths) * (factor / 1000)) << size;
      }
  }
}

TEST(Number, IsWholeAndWithinItsBounds) {
  EXPECT_EQ(number_of("7", 1, 9), 7);
  EXPECT_EQ(number_of("-7", -9, 9), -7);
  EXPECT_EQ(number_of("9223372036854775807", 0, std::numeric_limits<std::int64_t>::max()),
            std::numeric_limits<std::int64_t>::max());
  for (const auto* text : {"", "0", "10", "seven", "7.0", "7e0", "0x7", "+7", " 7", "7 ", "7 ms", "nan",
                           "inf", "99999999999999999999", "-99999999999999999999"})
    EXPECT_THROW(number_of(text, 1, 9), std::invalid_argument) << text;
}

}  // namespace
}  // namespace ontime::campaign

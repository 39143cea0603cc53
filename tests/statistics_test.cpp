// SPDX-License-Identifier: Apache-2.0
#include "statistics/statistics.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numeric>
#include <random>

#include <gtest/gtest.h>

#include "statistics/values.hpp"

namespace ontime::statistics {
namespace {

std::vector<std::int64_t> random_values(std::mt19937_64& random) {
  // Of all sizes about the ranks' edges; few different values in one, all different ones in another, and ones
  // that need more than 32 bits.
  static constexpr std::size_t sizes[] = {1, 2, 3, 9, 10, 11, 99, 100, 101, 999, 1000, 1001, 10000, 10001};
  std::vector<std::int64_t> values(random() % 2 != 0 ? sizes[random() % std::size(sizes)]
                                                     : 1 + random() % 3000);
  static constexpr std::uint64_t of_how_many[] = {5, 1'000'000'000, 1'000'000'000'000};
  const auto different = of_how_many[random() % std::size(of_how_many)];
  for (auto& value : values)
    value = static_cast<std::int64_t>(random() % different) - static_cast<std::int64_t>(different / 10);
  return values;
}

// The definition, word by word: the smallest value that at least `numerator` of `denominator` do not exceed.
std::int64_t by_definition(const std::vector<std::int64_t>& values, std::size_t numerator,
                           std::size_t denominator) {
  std::vector<std::int64_t> candidates = values;
  std::sort(candidates.begin(), candidates.end());
  candidates.erase(std::unique(candidates.begin(), candidates.end()), candidates.end());
  const auto enough = [&](std::int64_t candidate) {
    const auto count = static_cast<std::size_t>(
        std::count_if(values.begin(), values.end(), [&](std::int64_t value) { return value <= candidate; }));
    return count * denominator >= numerator * values.size();
  };
  // What is enough for one value is enough for every greater one.
  return *std::partition_point(candidates.begin(), candidates.end(), std::not_fn(enough));
}

TEST(Distribution, IsWhatTheDefinitionSays) {
  std::mt19937_64 random(1);
  for (int i = 0; i < 300; ++i) {
    const auto values = random_values(random);
    const auto found = distribution(values);
    ASSERT_EQ(found.count, values.size());
    ASSERT_EQ(found.min, *std::min_element(values.begin(), values.end()));
    ASSERT_EQ(found[Figure::p50], by_definition(values, 50, 100)) << values.size();
    ASSERT_EQ(found[Figure::p90], by_definition(values, 90, 100)) << values.size();
    ASSERT_EQ(found[Figure::p99], by_definition(values, 99, 100)) << values.size();
    ASSERT_EQ(found[Figure::p99_9], by_definition(values, 999, 1000)) << values.size();
    ASSERT_EQ(found[Figure::p99_99], by_definition(values, 9999, 10000)) << values.size();
    ASSERT_EQ(found.max, *std::max_element(values.begin(), values.end()));
    const auto sum = std::accumulate(values.begin(), values.end(), std::int64_t{0});
    ASSERT_NEAR(found.mean, static_cast<double>(sum) / static_cast<double>(values.size()),
                1e-9 * (1 + std::abs(found.mean)));
  }
}

TEST(Distribution, IsInOrderAndDoesNotDependOnTheOrderOfValues) {
  std::mt19937_64 random(2);
  for (int i = 0; i < 300; ++i) {
    auto values = random_values(random);
    auto shuffled = values;
    std::shuffle(shuffled.begin(), shuffled.end(), random);
    const auto a = distribution(values), b = distribution(shuffled);
    ASSERT_LE(a.min, a.quantiles.front());
    ASSERT_TRUE(std::ranges::is_sorted(a.quantiles));
    ASSERT_LE(a.quantiles.back(), a.max);
    ASSERT_EQ(std::tie(a.min, a.quantiles, a.max), std::tie(b.min, b.quantiles, b.max));
    ASSERT_LE(static_cast<double>(a.min), a.mean);
    ASSERT_LE(a.mean, static_cast<double>(a.max));
  }
}

TEST(Distribution, NoValuesGiveZero) {
  const auto found = distribution({});
  EXPECT_EQ(found.count, 0u);
  EXPECT_EQ(found.min, 0);
  EXPECT_EQ(found[Figure::p99_99], 0);
  EXPECT_EQ(found.max, 0);
  EXPECT_EQ(found.mean, 0);
}

TEST(Distribution, RanksAtTheirEdges) {
  std::vector<std::int64_t> values(10'000);
  std::iota(values.begin(), values.end(), 1);
  const auto found = distribution(values);
  EXPECT_EQ(found[Figure::p50], 5000);
  EXPECT_EQ(found[Figure::p99_9], 9990);
  EXPECT_EQ(found[Figure::p99_99], 9999);
  EXPECT_EQ(found.max, 10'000);
}

TEST(Distribution, MeanOfLargeValuesDoesNotOverflow) {
  const std::vector<std::int64_t> values(1000, std::int64_t{1} << 62);
  EXPECT_EQ(distribution(values).mean, std::ldexp(1.0, 62));
}

// Values that crowd together are counted instead of listed: it must not show.
TEST(Values, CrowdedValuesGiveTheSameRanks) {
  std::mt19937_64 random(6);
  std::vector<std::int64_t> values(300'000);
  for (auto& value : values)
    value = static_cast<std::int64_t>(random() % 10 != 0 ? 65'000 + random() % 1000 : random() % 10'000'000);
  const auto found = distribution(values);
  std::sort(values.begin(), values.end());
  EXPECT_EQ(found[Figure::p50], values[150'000 - 1]);
  EXPECT_EQ(found[Figure::p99], values[297'000 - 1]);
  EXPECT_EQ(found[Figure::p99_99], values[299'970 - 1]);
  EXPECT_EQ(found.max, values.back());
}

TEST(Values, SeriesEqualsValuesAddedOneByOne) {
  std::mt19937_64 random(7);
  for (int round = 0; round < 200; ++round) {
    Values values;
    std::vector<std::int64_t> expected;
    for (auto n = random() % 5; n > 0; --n) {
      const auto least = static_cast<std::int64_t>(random() % 10'000) - 3000;
      const auto step = static_cast<std::int64_t>(random() % 50);
      const auto count = random() % 100;
      values.add_series(Series::of(least, step, count));
      for (std::uint64_t i = 0; i < count; ++i)
        expected.push_back(least + step * static_cast<std::int64_t>(i));
      values.add(least + 7);
      expected.push_back(least + 7);
    }
    const auto one_by_one = distribution(expected);
    Ranks ranks(std::move(values));
    const auto found = ranks.distribution();
    ASSERT_EQ(found.count, one_by_one.count);
    ASSERT_EQ(std::tie(found.min, found.quantiles, found.max),
              std::tie(one_by_one.min, one_by_one.quantiles, one_by_one.max));
    ASSERT_NEAR(found.mean, one_by_one.mean, 1e-9 * (1 + std::abs(found.mean)));
    for (const std::int64_t limit : {-4000, 0, 17, 5000, 100'000})
      ASSERT_EQ(ranks.at_most(limit),
                std::count_if(expected.begin(), expected.end(), [&](auto value) { return value <= limit; }));
  }
}

TEST(Values, TakeWhatNoClockShows) {
  constexpr auto least = std::numeric_limits<std::int64_t>::min();
  constexpr auto most = std::numeric_limits<std::int64_t>::max();
  Values values;
  for (const auto value : {least, most, std::int64_t{0}, std::int64_t{-1}}) values.add(value);
  values.add_series(Series::of(most - 5, 1000, 1'000'000'000));
  values.add_series(Series::of(least, most, std::uint64_t{1} << 48));
  Ranks ranks(std::move(values));
  const auto found = ranks.distribution();
  EXPECT_EQ(found.min, least);
  EXPECT_EQ(found.max, most);
  EXPECT_EQ(ranks.at_most(most), found.count);
  for (const auto& bin : ranks.histogram()) EXPECT_LT(bin.from_ns, bin.to_ns);
}

TEST(Histogram, HoldsEachValueOnce) {
  std::mt19937_64 random(8);
  for (int round = 0; round < 100; ++round) {
    const auto expected = random_values(random);
    Values values;
    for (const auto value : expected) values.add(value);
    const auto bins = Ranks(std::move(values)).histogram();
    std::uint64_t all = 0;
    for (std::size_t i = 0; i < bins.size(); ++i) {
      const auto& [from, to, count] = bins[i];
      ASSERT_GT(count, 0u);
      if (i > 0) {
        ASSERT_LE(bins[i - 1].to_ns, from);
      }
      if (from >= 32) {
        ASSERT_LE(static_cast<double>(to - from), static_cast<double>(from) / 16);
      }
      ASSERT_EQ(count, std::count_if(expected.begin(), expected.end(),
                                     [&, from = from, to = to](auto v) { return from <= v && v < to; }));
      all += count;
    }
    ASSERT_EQ(all, expected.size());
  }
}

TEST(Histogram, BinsAreEquallyWideOnALogarithmicAxis) {
  // As many values between any two powers: on a logarithmic axis they are flat, and so must the counts be.
  Values values;
  constexpr int values_a_bin = 100;
  for (int i = 0; i < 10 * 16 * values_a_bin; ++i)
    values.add(std::llround(std::exp2(14 + (i + 0.5) / (16 * values_a_bin))));
  const auto bins = Ranks(std::move(values)).histogram();
  ASSERT_EQ(bins.size(), 160u);
  for (const auto& [from, to, count] : bins) {
    EXPECT_NEAR(std::log2(static_cast<double>(to) / static_cast<double>(from)), 1.0 / 16, 2e-4) << from;
    EXPECT_NEAR(static_cast<double>(count), values_a_bin, 2) << from;
  }
}

TEST(Estimate, FewValuesGiveTheirSpan) {
  EXPECT_FALSE(estimate({}));
  const auto one = estimate({7}).value();
  EXPECT_EQ(std::tie(one.median, one.low, one.high, one.confidence), std::make_tuple(7.0, 7.0, 7.0, 0.0));
  const auto five = estimate({5, 1, 4, 2, 3}).value();
  EXPECT_EQ(std::tie(five.median, five.low, five.high), std::make_tuple(3.0, 1.0, 5.0));
  EXPECT_DOUBLE_EQ(five.confidence, 1 - 2.0 / 32);
  EXPECT_EQ(estimate({1, 2, 3, 10})->median, 2.5);
}

TEST(Estimate, NineValuesLeaveOneOutOnEachSide) {
  const auto nine = estimate({9, 8, 7, 6, 5, 4, 3, 2, 1}).value();
  EXPECT_EQ(std::tie(nine.low, nine.high), std::make_tuple(2.0, 8.0));
  EXPECT_DOUBLE_EQ(nine.confidence, 1 - 2 * (1.0 + 9) / 512);  // tables of the sign test: 96.1 %
}

TEST(Estimate, ManyValuesHaveANarrowIntervalOfTheStatedConfidence) {
  std::vector<double> values(10'000);  // the binomial's 0.5^n is 0 in a double
  std::iota(values.begin(), values.end(), 1.0);
  const auto many = estimate(values).value();
  // Median ± 1.96 √n / 2 by the normal approximation.
  EXPECT_NEAR(many.low, 5000.5 - 98, 2);
  EXPECT_NEAR(many.high, 5000.5 + 98, 2);
  EXPECT_NEAR(many.confidence, 0.95, 0.002);
}

// What an interval of confidence means: of many, the stated share holds the true median.
TEST(Estimate, CoversTheMedianAsOftenAsItSays) {
  std::mt19937_64 random(5);
  std::exponential_distribution<double> skewed(1);
  const double true_median = std::log(2.0);
  for (const std::size_t n : {6, 9, 20}) {
    const int rounds = 20'000;
    int covered = 0;
    double confidence = 0;
    for (int round = 0; round < rounds; ++round) {
      std::vector<double> values(n);
      for (auto& value : values) value = skewed(random);
      const auto estimated = estimate(values).value();
      confidence = estimated.confidence;
      covered += estimated.low <= true_median && true_median <= estimated.high;
    }
    EXPECT_GE(confidence, 0.95) << n;
    EXPECT_NEAR(static_cast<double>(covered) / rounds, confidence, 0.006) << n;
  }
}

}  // namespace
}  // namespace ontime::statistics

// SPDX-License-Identifier: Apache-2.0
#include "statistics/statistics.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>

#include <gtest/gtest.h>

namespace ontime::statistics {
namespace {

using roundtrip::Fate;
using roundtrip::Sample;

std::vector<std::int64_t> random_values(std::mt19937_64& random) {
  // Of all sizes about the ranks' edges; few different values in one, all different ones in another.
  static constexpr std::size_t sizes[] = {1, 2, 3, 9, 10, 11, 99, 100, 101, 999, 1000, 1001, 10000, 10001};
  std::vector<std::int64_t> values(random() % 2 != 0 ? sizes[random() % std::size(sizes)]
                                                     : 1 + random() % 3000);
  const std::uint64_t different = random() % 2 != 0 ? 5 : 1'000'000'000;
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
    auto sorted = values;
    const auto found = distribution(sorted);
    ASSERT_EQ(found.count, values.size());
    ASSERT_EQ(found.min, *std::min_element(values.begin(), values.end()));
    ASSERT_EQ(found.p50, by_definition(values, 50, 100)) << values.size();
    ASSERT_EQ(found.p90, by_definition(values, 90, 100)) << values.size();
    ASSERT_EQ(found.p99, by_definition(values, 99, 100)) << values.size();
    ASSERT_EQ(found.p99_9, by_definition(values, 999, 1000)) << values.size();
    ASSERT_EQ(found.p99_99, by_definition(values, 9999, 10000)) << values.size();
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
    const std::vector<std::int64_t> ranks = {a.min, a.p50, a.p90, a.p99, a.p99_9, a.p99_99, a.max};
    ASSERT_TRUE(std::is_sorted(ranks.begin(), ranks.end()));
    ASSERT_EQ(ranks, std::vector({b.min, b.p50, b.p90, b.p99, b.p99_9, b.p99_99, b.max}));
    ASSERT_LE(static_cast<double>(a.min), a.mean);
    ASSERT_LE(a.mean, static_cast<double>(a.max));
  }
}

TEST(Distribution, OfNoValuesIsZero) {
  std::vector<std::int64_t> none;
  const auto found = distribution(none);
  EXPECT_EQ(found.count, 0u);
  EXPECT_EQ(found.min, 0);
  EXPECT_EQ(found.p99_99, 0);
  EXPECT_EQ(found.max, 0);
  EXPECT_EQ(found.mean, 0);
}

TEST(Distribution, RanksAtTheirEdges) {
  std::vector<std::int64_t> values(10'000);
  std::iota(values.begin(), values.end(), 1);
  const auto found = distribution(values);
  EXPECT_EQ(found.p50, 5000);
  EXPECT_EQ(found.p99_9, 9990);
  EXPECT_EQ(found.p99_99, 9999);
  EXPECT_EQ(found.max, 10'000);
}

TEST(Distribution, MeanOfLargeValuesDoesNotOverflow) {
  std::vector<std::int64_t> values(1000, std::int64_t{1} << 62);
  EXPECT_EQ(distribution(values).mean, std::ldexp(1.0, 62));
}

Sample random_sample(std::uint64_t index, std::mt19937_64& random) {
  const auto some_ns = [&](std::uint64_t below) { return static_cast<std::int64_t>(random() % below); };
  Sample sample{};
  sample.index = index;
  sample.fate = static_cast<Fate>(random() % 3);
  sample.skipped_cycles = static_cast<std::uint32_t>(random() % 4 == 0 ? random() % 10 : 0);
  sample.intended_ns = 1'000'000'000 + static_cast<std::int64_t>(index) * 10'000'000;
  sample.due_ns = sample.intended_ns + std::int64_t{sample.skipped_cycles} * 10'000'000;
  sample.woke_ns = sample.due_ns + some_ns(500'000);
  sample.sent_ns = sample.woke_ns + some_ns(50'000);
  if (sample.fate == Fate::lost) return sample;
  sample.received_ns = sample.sent_ns + 1 + some_ns(30'000'000);
  if (random() % 2 != 0) return sample;
  sample.server_received_ns = 5'000'000'000 + some_ns(1'000'000'000);
  sample.server_sent_ns = sample.server_received_ns + some_ns(100'000);
  return sample;
}

Summary summary_of(const std::vector<Sample>& samples, const nlohmann::json& asked) {
  record::Writer writer("");
  writer.append(writer.begin_run(asked), samples);
  const auto reader = writer.reader();
  return summarise(reader, reader.runs().at(0));
}

TEST(Summary, AddsUp) {
  std::mt19937_64 random(3);
  for (int i = 0; i < 50; ++i) {
    std::vector<Sample> samples;
    std::uint64_t skipped = 0, said = 0;
    for (std::size_t n = random() % 500; n > 0; --n) {
      samples.push_back(random_sample(samples.size(), random));
      skipped += samples.back().skipped_cycles;
      if (samples.back().server_sent_ns != 0) ++said;
    }
    const auto of = [&](Fate fate) {
      return static_cast<std::uint64_t>(
          std::count_if(samples.begin(), samples.end(), [&](const Sample& s) { return s.fate == fate; }));
    };
    const auto summary = summary_of(samples, {{"schedule", "next-free"}});
    ASSERT_EQ(summary.sent, samples.size());
    ASSERT_EQ(summary.on_time, of(Fate::on_time));
    ASSERT_EQ(summary.late, of(Fate::late));
    ASSERT_EQ(summary.lost, of(Fate::lost));
    ASSERT_EQ(summary.sent, summary.on_time + summary.late + summary.lost);
    ASSERT_EQ(summary.skipped_cycles, skipped);
    ASSERT_EQ(summary.round_trip.count, summary.on_time + summary.late);
    ASSERT_EQ(summary.response.count, summary.round_trip.count);
    ASSERT_EQ(summary.wake_up.count, summary.sent);
    ASSERT_EQ(summary.server.count, said);
    ASSERT_GE(summary.response.max, summary.round_trip.max) << "a response holds its round trip";
    ASSERT_GE(summary.response.mean, summary.round_trip.mean);
  }
}

TEST(Summary, SaysFromWhereToWhere) {
  Sample sample{};
  sample.intended_ns = 100;
  sample.due_ns = 200;
  sample.woke_ns = 230;
  sample.sent_ns = 234;
  sample.received_ns = 1234;
  sample.server_received_ns = 5000;
  sample.server_sent_ns = 5007;
  const auto summary = summary_of({sample}, {{"schedule", "fixed"}});
  EXPECT_EQ(summary.round_trip.max, 1000);
  EXPECT_EQ(summary.response.max, 1134);
  EXPECT_EQ(summary.wake_up.max, 30);
  EXPECT_EQ(summary.server.max, 7);
}

TEST(Summary, BackToBackHasNoWakeUp) {
  std::mt19937_64 random(4);
  const std::vector<Sample> samples = {random_sample(0, random), random_sample(1, random)};
  EXPECT_EQ(summary_of(samples, {{"schedule", "back-to-back"}}).wake_up.count, 0u);
  for (const nlohmann::json& asked : {nlohmann::json(), nlohmann::json(7), nlohmann::json({{"schedule", 7}})})
    EXPECT_EQ(summary_of(samples, asked).wake_up.count, 2u) << asked;
}

TEST(Estimate, OfFewValuesIsWhatTheySpan) {
  EXPECT_FALSE(estimate({}));
  const auto one = estimate({7}).value();
  EXPECT_EQ(std::tie(one.median, one.low, one.high, one.confidence), std::make_tuple(7.0, 7.0, 7.0, 0.0));
  const auto five = estimate({5, 1, 4, 2, 3}).value();
  EXPECT_EQ(std::tie(five.median, five.low, five.high), std::make_tuple(3.0, 1.0, 5.0));
  EXPECT_DOUBLE_EQ(five.confidence, 1 - 2.0 / 32);
  EXPECT_EQ(estimate({1, 2, 3, 10})->median, 2.5);
}

TEST(Estimate, OfNineLeavesOneOutOnEachSide) {
  const auto nine = estimate({9, 8, 7, 6, 5, 4, 3, 2, 1}).value();
  EXPECT_EQ(std::tie(nine.low, nine.high), std::make_tuple(2.0, 8.0));
  EXPECT_DOUBLE_EQ(nine.confidence, 1 - 2 * (1.0 + 9) / 512);  // tables of the sign test: 96.1 %
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

Summary layer_run(const char* id, const char* adds_to, int repetition, std::int64_t p50_ns,
                  nlohmann::json thread) {
  Summary summary;
  summary.run.asked = {{"id", id}, {"transport", "t"}, {"adds_to", adds_to}, {"repetition", repetition}};
  summary.run.outcome = {{"hosts", {{"controller", {{"threads", {thread, thread}}}}}}};
  summary.sent = 10;
  summary.round_trip.count = 10;
  summary.round_trip.p50 = p50_ns;
  return summary;
}

TEST(Layers, AreComparedRepetitionByRepetition) {
  std::vector<Summary> runs;
  for (int repetition = 1; repetition <= 3; ++repetition) {
    // The machine drifts by more than the layer costs; what the layer adds does not.
    runs.push_back(
        layer_run("below", "", repetition, 1000 * repetition, {{"cpu_time_us", 1}, {"instructions", 50}}));
    runs.push_back(layer_run("above", "below", repetition, 1000 * repetition + 10,
                             {{"cpu_time_us", 3}, {"instructions", nullptr}}));
    runs.push_back(layer_run("apart", "", repetition, 5, {}));
  }
  const auto found = layers(runs);
  ASSERT_EQ(found.size(), 2U);
  EXPECT_EQ(found[0].id, "below");
  EXPECT_FALSE(found[0].round_trip_ns.added);
  EXPECT_EQ(found[0].instructions.total->median, 10) << "both threads, a message";
  EXPECT_EQ(found[1].round_trip_ns.total->median, 2010);
  EXPECT_EQ(found[1].round_trip_ns.added->median, 10);
  EXPECT_EQ(found[1].round_trip_ns.added->high, 10);
  EXPECT_EQ(found[1].cpu_ns.added->median, 400);
  EXPECT_FALSE(found[1].instructions.total) << "not counted is not zero";
}

TEST(Layers, TakeAnyRecord) {
  for (const nlohmann::json& odd :
       {nlohmann::json(), nlohmann::json(7), nlohmann::json::array({1}),
        nlohmann::json({{"id", 7}, {"adds_to", 7}, {"repetition", "x"}, {"hosts", 7}})}) {
    Summary summary;
    summary.run.asked = summary.run.outcome = odd;
    EXPECT_NO_THROW(layers({summary, summary, layer_run("a", "b", 1, 1, odd)})) << odd;
  }
}

}  // namespace
}  // namespace ontime::statistics

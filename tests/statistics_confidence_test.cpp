// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <limits>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "statistics_series.hpp"

namespace ontime::statistics {
namespace {

bool holds(const Interval& interval, double value) {
  return interval.low.value_or(-std::numeric_limits<double>::infinity()) <= value &&
         value <= interval.high.value_or(std::numeric_limits<double>::infinity());
}

TEST(Certainty, HoldsTheTrueQuantilesAsOftenAsItSays) {
  const int runs = trials(30, 200);
  constexpr std::size_t samples = 20'000;
  for (const auto& kind : kinds()) {
    Random random(21);
    std::array<int, percentiles.size()> held{}, held_surer{}, bounded{};
    for (int i = 0; i < runs; ++i) {
      const auto found = run_of(kind.series(samples, random)).round_trip_certainty;
      for (std::size_t k = 0; k < percentiles.size(); ++k) {
        const auto& measured = found[percentiles[k].figure];
        const auto truth = kind.quantile(1 - percentiles[k].share_above());
        held[k] += holds(measured.sure, truth) ? 1 : 0;
        held_surer[k] += holds(measured.surer, truth) ? 1 : 0;
        bounded[k] += measured.sure.low && measured.sure.high ? 1 : 0;
      }
    }
    for (std::size_t k = 0; k < percentiles.size(); ++k) {
      EXPECT_GE(held[k], runs * 90 / 100) << kind.name << " " << percentiles[k].name;
      EXPECT_GE(held_surer[k], runs * 93 / 100) << kind.name << " " << percentiles[k].name;
    }
    // And not by saying nothing, but of the p99 of few bursts or effective messages.
    for (std::size_t k = 0; k < 2; ++k) EXPECT_GE(bounded[k], runs * 80 / 100) << kind.name;
    EXPECT_TRUE(bounded[2] >= runs * 80 / 100 || kind.name != "independent");
  }
}

TEST(Certainty, SaysWhichQuantilesTheRunDoesNotSupport) {
  Random random(22);
  const auto few = run_of(kinds().front().series(1000, random)).round_trip_certainty;
  EXPECT_TRUE(few[Figure::p90].sure.high);
  EXPECT_FALSE(few[Figure::p99].sure.high);
  EXPECT_STREQ(few[Figure::p99].open, "fewer than 30 slower messages");
  EXPECT_FALSE(few[Figure::p99_9].sure.high);
  EXPECT_TRUE(few[Figure::p99_9].sure.low);
  EXPECT_FALSE(few[Figure::p99_99].sure.high);
  const auto one = run_of({5}).round_trip_certainty;
  EXPECT_EQ(one[Figure::p50].value, 5);
  EXPECT_FALSE(one[Figure::p50].sure.low);
  EXPECT_FALSE(one[Figure::p50].sure.high);
  EXPECT_FALSE(one.mean.sure.low);
}

// A few huge values widen the interval of Student's t to below 0, where no time is.
TEST(Certainty, MeanOfTimesIsNotBelow0) {
  std::vector<std::int64_t> times(1000, 100);
  times[500] = 100'000;
  const auto mean = run_of(times).round_trip_certainty.mean;
  EXPECT_EQ(mean.sure.low, 0);
  EXPECT_EQ(mean.surer.low, 0);
  times[500] = -100'000'000;
  EXPECT_LT(*run_of(times).round_trip_certainty.mean.sure.low, -1000) << "an age by two clocks";
}

TEST(Certainty, IndependentValuesGiveOrderStatistics) {
  // Of 100 the median lies between the 40th and the 61st: Conover 1999, table A3.
  const auto shares = quantile_shares(0.5, 100, 0.95);
  EXPECT_NEAR(*shares.low, 0.40, 1e-9);
  EXPECT_NEAR(*shares.high, 0.61, 1e-9);
  EXPECT_FALSE(quantile_shares(0.5, 5, 0.95).high);  // of 5 it is outside with 1/16
  EXPECT_NEAR(*quantile_shares(0.5, 6, 0.95).high, 1, 1e-9);
  EXPECT_FALSE(quantile_shares(0.99, 367, 0.95).high);
  EXPECT_TRUE(quantile_shares(0.99, 368, 0.95).high);  // 0.99^367 is 0.025
  EXPECT_FALSE(quantile_shares(0.5, 0, 0.95).low);
}

TEST(DesignEffect, IsOneOfIndependentAndTheLengthOfBursts) {
  Random random(23);
  Batches independent, in_bursts;
  bool event = false;
  for (int i = 0; i < 60'000; ++i) {
    independent.add(uniform(random) < 0.1);
    if (i % 20 == 0) event = uniform(random) < 0.1;
    in_bursts.add(event);
  }
  EXPECT_LT(design_effect(independent.all()), 2);
  EXPECT_GT(design_effect(in_bursts.all()), 20);
  EXPECT_LT(design_effect(in_bursts.all()), 45);
}

TEST(Batches, LoseNothingHoweverManyCome) {
  for (const std::size_t count : {0u, 1u, 127u, 128u, 129u, 1000u, 4097u}) {
    Batches batches;
    for (std::size_t i = 0; i < count; ++i) batches.add(i % 3 == 0);
    double values = 0, events = 0;
    for (const auto& batch : batches.all()) {
      values += batch.values;
      events += batch.events;
    }
    EXPECT_EQ(values, count);
    EXPECT_EQ(events, (count + 2) / 3);
    EXPECT_LE(batches.all().size(), most_batches);
  }
}

TEST(Course, CountsALongSeriesAsTheValuesThatItIs) {
  Course whole, single;
  for (int i = 0; i < 1000; ++i) {
    whole.add(50);
    single.add(50);
  }
  whole.add_series({100, 10, 500});
  for (int i = 0; i < 500; ++i) single.add(100 + 10 * i);
  whole.add_series({7, 0, 3});
  for (int i = 0; i < 3; ++i) single.add(7);
  const auto total = [](const std::vector<Batch>& batches) {
    Batch sum;
    for (const auto& [values, events] : batches) {
      sum.values += values;
      sum.events += events;
    }
    return std::pair{sum.values, sum.events};
  };
  for (const auto count : {Course::Count::above, Course::Count::at_or_above})
    for (const std::int64_t threshold : {0, 7, 50, 100, 2000, 6000})
      EXPECT_EQ(total(whole.events({&threshold, 1}, count)[0]),
                total(single.events({&threshold, 1}, count)[0]))
          << threshold;
  EXPECT_EQ(total(whole.sums()), total(single.sums()));
}

Probability of_batches(const std::vector<bool>& events, double effect_of_few = 1) {
  Batches batches;
  for (const auto event : events) batches.add(event);
  return probability(batches.all(), effect_of_few);
}

TEST(Probability, HasABoundAfterNoEvent) {
  const std::vector<bool> none(100'000);
  const auto independent = of_batches(none);
  EXPECT_EQ(independent.value, 0);
  EXPECT_EQ(independent.sure.low, 0);
  EXPECT_NEAR(independent.bound, 3e-5, 1e-7);  // the rule of three
  EXPECT_NEAR(*independent.sure.high, 3.69e-5, 1e-7);
  EXPECT_NEAR(of_batches(none, 10).bound, 3e-4, 1e-6);
  EXPECT_EQ(of_batches({}).messages, 0u);
  const auto always = of_batches(std::vector<bool>(1000, true));
  EXPECT_EQ(always.bound, 1);
  EXPECT_NEAR(*always.sure.low, std::pow(0.025, 1.0 / 1000), 1e-9);
}

TEST(Probability, IsNoLowerForAnEventMore) {
  std::vector<bool> events(60'000);
  auto before = of_batches(events, 20);
  EXPECT_EQ(before.effect, 20);
  for (std::size_t count = 1; count <= 40; ++count) {
    // As evenly as can be: nothing but the effect of few speaks of bursts.
    events.assign(events.size(), false);
    for (std::size_t i = 0; i < count; ++i) events[(2 * i + 1) * events.size() / (2 * count)] = true;
    const auto found = of_batches(events, 20);
    EXPECT_EQ(found.effect, count < 10 ? 20 : 1) << count;
    EXPECT_GE(found.bound, before.bound) << count;
    EXPECT_GE(found.sure.high, before.sure.high) << count;
    EXPECT_GE(found.surer.high, before.surer.high) << count;
    before = found;
  }
  std::vector<bool> nearly_all(60'000, true);
  const auto all = of_batches(nearly_all, 20);
  nearly_all[30'000] = false;
  EXPECT_EQ(of_batches(nearly_all, 20).sure.low, all.sure.low);
}

TEST(Probability, IsThatOfClopperAndPearson) {
  // One event in each of ten of 100 messages: 10 of 1000, spread as evenly as can be.
  std::vector<bool> events(1000);
  for (std::size_t i = 50; i < events.size(); i += 100) events[i] = true;
  const auto found = of_batches(events);
  EXPECT_EQ(found.effect, 1);
  EXPECT_NEAR(*found.sure.low, 0.004806, 1e-6);  // R: binom.test(10, 1000)
  EXPECT_NEAR(*found.sure.high, 0.018313, 1e-6);
}

TEST(Probability, HoldsTheTrueOneThoughMissesComeInBursts) {
  const int runs = trials(40, 300);
  constexpr double calm = 2000, burst = 20;
  Random random(24);
  int held = 0, below_bound = 0;
  for (int i = 0; i < runs; ++i) {
    Batches batches;
    bool in_burst = uniform(random) < burst / (calm + burst);
    for (int k = 0; k < 60'000; ++k) {
      batches.add(in_burst);
      if (uniform(random) < 1 / (in_burst ? burst : calm)) in_burst = !in_burst;
    }
    const auto found = probability(batches.all(), 1);
    held += holds(found.sure, burst / (calm + burst)) ? 1 : 0;
    below_bound += found.bound > burst / (calm + burst) ? 1 : 0;
  }
  EXPECT_GE(held, runs * 90 / 100);
  EXPECT_GE(below_bound, runs * 90 / 100);
}

// As summarise() does: the misses of a run of which none or hardly any was missed.
Probability missed(const Times_ns& values, double deadline_ns) {
  Batches batches;
  for (const auto value : values) batches.add(static_cast<double>(value) > deadline_ns);
  return probability(batches.all(), run_of(values).round_trip_certainty.slowest_effect);
}

TEST(Probability, HoldsTheTrueOneThoughHardlyAnyIsMissed) {
  const int runs = trials(30, 200);
  for (const auto& kind : kinds())
    for (const double truth : {1e-4, 3e-4, 1e-3}) {  // of 20,000 messages two, six, or twenty
      Random random(25);
      int held = 0, without = 0;
      for (int i = 0; i < runs; ++i) {
        const auto found = missed(kind.series(20'000, random), kind.quantile(1 - truth));
        held += found.bound > truth ? 1 : 0;
        if (found.events > 0) continue;
        ++without;
        EXPECT_LT(found.bound, 0.01) << kind.name;
      }
      EXPECT_GE(held, runs * 9 / 10 - 1) << kind.name << " " << truth;
      EXPECT_TRUE(without > 0 || truth > 1e-4) << kind.name;
    }
}

// The stalls of a run, ten messages in a row each, whose answers come in the order in which they were sent.
constexpr std::size_t stalled = 10;
void stall(Times_ns& values, std::size_t first, std::int64_t longest_ns) {
  for (std::size_t k = 0; k < stalled && first + k < values.size(); ++k)
    values[first + k] = longest_ns - static_cast<std::int64_t>(k) * 1'000'000;
}

TEST(SlowestEffect, IsNotLessForASlowestThatCameAllInOneStall) {
  Random random(27);
  for (const std::size_t messages :
       {900u, 10'000u}) {  // of which the slowest hundredth, or thousandth, stalled
    auto values = kinds().front().series(messages, random);
    stall(values, messages / 3, 30'000'000);
    const auto effect = run_of(values).round_trip_certainty.slowest_effect;
    EXPECT_GT(effect, stalled * 0.8) << messages;
    EXPECT_LT(effect, stalled * 1.6) << messages;
  }
}

TEST(Probability, HoldsTheTrueOneThoughARunHasFewStallsOrNone) {
  const int runs = trials(60, 300);
  constexpr std::size_t messages = 10'000;
  constexpr double stalls = 4, truth = stalls * stalled / 2 / messages;
  // Of 20 to 40 ms. Half of them pass the deadline with all of their messages, or all of them with half.
  for (const bool wholly : {true, false}) {
    Random random(28);
    int held = 0, without = 0, held_without = 0;
    for (int i = 0; i < runs; ++i) {
      auto values = kinds().front().series(messages, random);
      std::vector<bool> misses(messages);
      for (std::size_t at = 0; at < messages; ++at) {
        if (uniform(random) >= stalls / messages) continue;
        const auto longest_ns = 20'000'000 + std::llround(20e6 * uniform(random));
        const bool beyond = !wholly || uniform(random) < 0.5;
        stall(values, at, longest_ns + (wholly && beyond ? 80'000'000 : 0));
        for (std::size_t k = 0; beyond && k < (wholly ? stalled : stalled / 2) && at + k < messages; ++k)
          misses[at + k] = true;
      }
      const auto found = of_batches(misses, run_of(values).round_trip_certainty.slowest_effect);
      const int holds_it = found.bound > truth ? 1 : 0;
      held += holds_it;
      if (found.events > 0) continue;
      ++without;
      held_without += holds_it;
    }
    EXPECT_GE(held, runs * 90 / 100) << wholly;
    if (wholly) {  // one run in seven sees none, and one of seven of these not even a stall
      EXPECT_GT(without, runs / 20);
      EXPECT_GE(held_without, without / 2);
    }
  }
}

TEST(Probability, CalmRunWithoutAMissIsNearTheRuleOfThree) {
  const int runs = trials(30, 200);
  for (const double rho : {0.0, 0.5})
    for (const double messages : {1000.0, 10'000.0}) {
      Random random(29);
      double sum = 0;
      for (int i = 0; i < runs; ++i) {
        const auto values = autoregressive("", rho).series(static_cast<std::size_t>(messages), random);
        const auto times = missed(values, 1e12).bound / (3 / messages);
        EXPECT_LT(times, 12) << rho << " " << messages;
        sum += times;
      }
      EXPECT_LT(sum / runs, 3) << rho << " " << messages;
    }
}

TEST(Probability, IsNotBoundedByHowTheMedianDrifts) {
  Random random(26);
  for (int i = 0; i < 20; ++i) {
    Times_ns values(1000);  // 300 µs, and 5 µs more in the end; 20 µs more now and then
    for (std::size_t k = 0; k < values.size(); ++k)
      values[k] = 300'000 + static_cast<std::int64_t>(5 * k) + std::llround(1000 * normal(random)) +
                  (uniform(random) < 0.05 ? std::llround(20'000 * uniform(random)) : 0);
    const auto sure = run_of(values).round_trip_certainty;
    EXPECT_GT(sure[Figure::p50].effect, 50);
    EXPECT_LT(missed(values, 10e6).bound, 0.1);
  }
}

TEST(Probability, OneInAMillionIsClaimedAfterThreeMillion) {
  EXPECT_NEAR(messages_to_claim(1e-6, 1), 2'995'731, 1);
  EXPECT_NEAR(messages_to_claim(1e-6, 4), 4 * 2'995'731, 4);
}

}  // namespace
}  // namespace ontime::statistics

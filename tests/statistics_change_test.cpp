// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "statistics_series.hpp"

namespace ontime::statistics {
namespace {

constexpr std::size_t samples = 60'000;  // the paper's: ten minutes at 100 Hz

bool gate_fails(const Summary& before, const Summary& after, Figure figure, double ratio) {
  const auto found = change({&before}, {&after}, Times::round_trip, figure);
  return ratio_exceeds(*found, ratio) == Answer::yes;
}

TEST(Gate, DoesNotCryWolfBetweenTheHalvesOfARun) {
  for (const auto& kind : kinds()) {
    Random random(11);
    constexpr int trials = 200;
    std::map<Figure, int> ten_percent, any;
    for (int i = 0; i < trials; ++i) {
      const auto run = kind.series(samples / 2, random);
      const auto middle = run.begin() + samples / 4;
      const auto one = run_of({run.begin(), middle}), other = run_of({middle, run.end()});
      for (const auto figure : {Figure::mean, Figure::p50, Figure::p99, Figure::p99_9}) {
        ten_percent[figure] += gate_fails(one, other, figure, 1.10) ? 1 : 0;
        any[figure] += gate_fails(one, other, figure, 1.00) ? 1 : 0;
      }
    }
    for (const auto& [figure, count] : ten_percent) {
      SCOPED_TRACE(kind.name + std::string(", figure ") + std::to_string(static_cast<int>(figure)));
      EXPECT_LT(count, trials / 100);
      EXPECT_LE(any[figure], trials * 3 / 100);  // of one in a hundred, what chance may make of it
    }
  }
}

TEST(Gate, SeesAShiftOfTwentyPercent) {
  for (const auto& kind : kinds()) {
    Random random(12);
    constexpr int trials = 20;
    int seen = 0;
    for (int i = 0; i < trials; ++i) {
      auto slower = kind.series(samples, random);
      for (auto& value : slower) value += value / 5;
      seen += gate_fails(run_of(kind.series(samples, random)), run_of(slower), Figure::p99, 1.10) ? 1 : 0;
    }
    EXPECT_GE(seen, trials * 9 / 10) << kind.name;
  }
}

Measured between(double low, double value, double high) { return {value, {}, {low, high}}; }

Summary with_p99(const Measured& p99) {
  Summary summary;
  summary.round_trip.count = 1;
  summary.round_trip_certainty.p99 = p99;
  return summary;
}

TEST(Change, IsBetterOrWorseOnlyWhereTheIntervalsTellIt) {
  const auto base = with_p99(between(90, 100, 110));
  const auto verdict = [&](const Measured& p99) {
    const auto run = with_p99(p99);
    return change({&base}, {&run}, Times::round_trip, Figure::p99)->verdict;
  };
  EXPECT_EQ(verdict(between(120, 130, 140)), Verdict::worse);
  EXPECT_EQ(verdict(between(60, 70, 80)), Verdict::better);
  EXPECT_EQ(verdict(between(90, 105, 120)), Verdict::cannot_tell);
  EXPECT_EQ(verdict({130, {}, {120, {}}}), Verdict::worse);  // how much, nobody knows
  EXPECT_EQ(verdict({130, {}, {{}, 140}}), Verdict::cannot_tell);
  EXPECT_EQ(verdict({70, {}, {{}, 80}}), Verdict::better);
}

TEST(Change, TakesItsIntervalFromBoth) {
  const auto from = with_p99(between(97, 100, 104)), to = with_p99(between(196, 200, 203));
  const auto found = *change({&from}, {&to}, Times::round_trip, Figure::p99);
  EXPECT_DOUBLE_EQ(*found.difference_lies.low, 100 - std::hypot(4, 4));
  EXPECT_DOUBLE_EQ(*found.difference_lies.high, 100 + std::hypot(3, 3));
  EXPECT_NEAR(*found.ratio, 2, 1e-12);
  EXPECT_NEAR(*found.ratio_lies.low, 1.9, 0.02);
}

TEST(Gate, IsPassedByWhatWasMeasuredUnlessItMayBeChance) {
  Change change;
  change.from = 100;
  change.to = 125;
  change.ratio = 1.25;
  change.ratio_lies = {1.05, 1.5};
  change.difference_lies = {5, 50};
  EXPECT_EQ(ratio_exceeds(change, 1.1), Answer::yes);
  EXPECT_EQ(ratio_exceeds(change, 1.25), Answer::no);
  EXPECT_EQ(ratio_exceeds(change, 0.9), Answer::yes);
  EXPECT_EQ(difference_exceeds(change, 20), Answer::yes);
  EXPECT_EQ(difference_exceeds(change, 25), Answer::no);
  change.ratio_lies = {0.95, 1.6};
  change.difference_lies = {};
  EXPECT_EQ(ratio_exceeds(change, 1.1), Answer::cannot_tell);
  EXPECT_EQ(ratio_exceeds(change, 0.9),
            Answer::yes);  // an improvement was asked for, and surely is not there
  EXPECT_EQ(difference_exceeds(change, 20), Answer::cannot_tell);
  change.ratio.reset();
  EXPECT_EQ(ratio_exceeds(change, 1.1), Answer::cannot_tell);
  EXPECT_EQ(exceeds(between(99, 100, 101), 98), Answer::yes);
  EXPECT_EQ(exceeds(between(99, 100, 101), 101), Answer::no);
  EXPECT_EQ(exceeds(between(99, 100, 101), 100), Answer::cannot_tell);
}

TEST(Change, OfRepetitionsCountsHowMuchTheyDiffer) {
  // Each surely another than the others, by its own samples: the runs differ more than these tell.
  const std::vector<Summary> runs = {with_p99(between(99, 100, 101)),  with_p99(between(119, 120, 121)),
                                     with_p99(between(139, 140, 141)), with_p99(between(139, 140, 141)),
                                     with_p99(between(159, 160, 161)), with_p99(between(179, 180, 181))};
  const auto found =
      *change({&runs[0], &runs[1], &runs[2]}, {&runs[3], &runs[4], &runs[5]}, Times::round_trip, Figure::p99);
  EXPECT_DOUBLE_EQ(found.from, 120);
  EXPECT_DOUBLE_EQ(found.to, 160);
  // Student's t of 4 degrees at 99 % is 3.747, the deviation of either side 20.
  EXPECT_NEAR(*found.difference_lies.low, 40 - 3.747 * 20 * std::sqrt(2.0 / 3), 0.01);
  EXPECT_EQ(found.verdict, Verdict::cannot_tell);
}

TEST(Change, HasTheRatioOfTheTwoNumbersBesideIt) {
  const auto calm = with_p99(between(99, 100, 101));
  const std::vector<Summary> uneven = {with_p99(between(49, 50, 51)), with_p99(between(49, 50, 51)),
                                       with_p99(between(259, 260, 261))};
  const auto found =
      *change({&calm, &calm, &calm}, {&uneven[0], &uneven[1], &uneven[2]}, Times::round_trip, Figure::p99);
  EXPECT_DOUBLE_EQ(*found.ratio, 1.2) << "by the geometric means it would be better";
  EXPECT_LE(*found.ratio_lies.low, 1.2);
  EXPECT_GE(*found.ratio_lies.high, 1.2);
  const auto unbounded = with_p99({130, {}, {{}, 140}});
  EXPECT_FALSE(change({&calm}, {&unbounded}, Times::round_trip, Figure::p99)->ratio_lies.low);
}

TEST(Change, IsOfWhatBothHave) {
  const auto answered = with_p99(between(1, 2, 3));
  const Summary empty;
  EXPECT_FALSE(change({&answered}, {&empty}, Times::round_trip, Figure::p99));
  EXPECT_FALSE(change({}, {&answered}, Times::round_trip, Figure::p99));
  EXPECT_FALSE(measured(answered, Times::round_trip, Figure::late));
}

}  // namespace
}  // namespace ontime::statistics

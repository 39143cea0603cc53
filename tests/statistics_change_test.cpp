// SPDX-License-Identifier: Apache-2.0
#include <map>

#include <fmt/format.h>
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
    const int runs = trials(60, 400);
    std::map<Figure, int> ten_percent, any;
    for (int i = 0; i < runs; ++i) {
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
      EXPECT_LE(count, runs / 100);
      EXPECT_LE(any[figure], runs * 4 / 100);  // of one in a hundred, what chance may make of it
    }
  }
}

TEST(Gate, SeesAShiftOfTwentyPercent) {
  for (const auto& kind : kinds()) {
    Random random(12);
    const int runs = trials(5, 100);
    int seen = 0;
    for (int i = 0; i < runs; ++i) {
      auto slower = kind.series(samples, random);
      for (auto& value : slower) value += value / 5;
      seen += gate_fails(run_of(kind.series(samples, random)), run_of(slower), Figure::p99, 1.10) ? 1 : 0;
    }
    // Nine of ten, less what chance takes: of a hundred such tries at least 82 succeed in 99 of 100 tests.
    // For five repetitions, of which nine of ten are promised, see below.
    EXPECT_GE(seen, runs * 82 / 100) << kind.name;
    if (runs >= 100) fmt::print("{:<15} single runs: found {} of {}\n", kind.name, seen, runs);
  }
}

// As repetitions differ: all of a run is so many times as long as of another.
std::vector<Summary> repetitions(const Kind& kind, std::size_t count, std::size_t messages, double spread,
                                 double factor, Random& random) {
  std::vector<Summary> runs;
  for (std::size_t i = 0; i < count; ++i) {
    auto values = kind.series(messages, random);
    const double times = factor * std::exp(spread * normal(random));
    for (auto& value : values) value = std::llround(static_cast<double>(value) * times);
    runs.push_back(run_of(values));
  }
  return runs;
}

std::vector<const Summary*> all_of(const std::vector<Summary>& runs) {
  std::vector<const Summary*> pointers;
  for (const auto& run : runs) pointers.push_back(&run);
  return pointers;
}

std::optional<Change> change_of(const std::vector<Summary>& from, const std::vector<Summary>& to,
                                Figure figure) {
  return change(all_of(from), all_of(to), Times::round_trip, figure);
}

TEST(Gate, SeesTwentyPercentAtP99InNineOfTenWithFiveRepetitions) {
  const int tries = trials(4, 100);
  for (const auto& kind : kinds())
    for (const double spread : {0.0, 0.03}) {
      Random random(13);
      int seen = 0;
      for (int i = 0; i < tries; ++i) {
        const auto a = repetitions(kind, 5, 10'000, spread, 1, random),
                   b = repetitions(kind, 5, 10'000, spread, 1.2, random);
        seen += ratio_exceeds(*change_of(a, b, Figure::p99), 1.1) == Answer::yes ? 1 : 0;
      }
      // The measured change itself is below +10 % now and then.
      EXPECT_GE(seen, tries * 9 / 10) << kind.name << " " << spread;
      if (tries >= 100)
        fmt::print("{:<15} spread {} %: found {} of {}\n", kind.name, 100 * spread, seen, tries);
    }
}

TEST(Gate, RarelyFailsOnEqualRepetitionsHoweverMuchTheyDiffer) {
  const int tries = trials(30, 300);
  for (const auto& kind : {kinds().front(), one_over_f()})
    for (const std::size_t count : {2u, 5u}) {
      Random random(14);
      int failed = 0, any = 0;
      for (int i = 0; i < tries; ++i) {
        const auto a = repetitions(kind, count, 1000, 0.1, 1, random),
                   b = repetitions(kind, count, 1000, 0.1, 1, random);
        for (const auto figure : {Figure::mean, Figure::p50, Figure::p99}) {
          const auto found = *change_of(a, b, figure);
          failed += ratio_exceeds(found, 1.1) == Answer::yes ? 1 : 0;
          any += found.verdict() == Verdict::worse ? 1 : 0;
        }
      }
      // All three of a pair, or none: they have the same spread.
      EXPECT_LE(failed, 3 * std::max(1, tries * 2 / 100)) << kind.name << " " << count;
      EXPECT_LE(any, 3 * tries * 4 / 100) << kind.name << " " << count;
      if (tries >= 100)
        fmt::print("{:<15} {} a side: p > +10 % fails {} of {}\n", kind.name, count, failed, 3 * tries);
    }
}

Measured between(double low, double value, double high) { return {value, {}, {low, high}}; }

Summary with_p99(const Measured& p99) {
  Summary summary;
  summary.round_trip.count = 1000;
  summary.round_trip_certainty[Figure::p99] = p99;
  return summary;
}

// Two runs that differ much, against ten alike: the variance of both together is that of the ten.
TEST(Change, SpreadOfTheFewRunsThatDifferCountsBesideManyThatDoNot) {
  Random random(16);
  const int tries = 4000;
  for (const std::size_t many : {2u, 5u, 10u}) {
    int claimed = 0;
    for (int i = 0; i < tries; ++i) {
      const auto runs_of = [&](std::size_t count, double deviation) {
        std::vector<Summary> runs;
        for (std::size_t k = 0; k < count; ++k) {
          const double p99 = 1e6 * std::exp(deviation * normal(random));
          runs.push_back(with_p99(between(0.99 * p99, p99, 1.01 * p99)));
        }
        return runs;
      };
      claimed +=
          change_of(runs_of(2, 0.2), runs_of(many, 0.02), Figure::p99)->verdict() == Verdict::cannot_tell ? 0
                                                                                                          : 1;
    }
    EXPECT_LE(claimed, tries * 7 / 100) << many << " runs; 41 % with Student's t of ten";
  }
}

// Of two runs with three slow answers of 300, and two with four, the p99 is that of two modes: by chance.
TEST(Change, SpreadOfFewRunsDecidesNothingWhereTheirSamplesGiveNoLimit) {
  const auto verdict_of = [](std::size_t before, std::size_t after) {
    std::vector<Summary> from, to;
    for (std::size_t i = 0; i < before; ++i)
      from.push_back(with_p99({100.0 + static_cast<double>(i), {}, {}}));
    for (std::size_t i = 0; i < after; ++i) to.push_back(with_p99({5000.0 + static_cast<double>(i), {}, {}}));
    return change_of(from, to, Figure::p99)->verdict();
  };
  for (const std::size_t few : {2U, 3U, 4U}) EXPECT_EQ(verdict_of(few, few), Verdict::cannot_tell) << few;
  EXPECT_EQ(verdict_of(5, 5), Verdict::worse);
  EXPECT_EQ(verdict_of(2, 20), Verdict::worse);
  EXPECT_EQ(verdict_of(2000, 2000), Verdict::worse);
  EXPECT_EQ(verdict_of(1, 2000), Verdict::cannot_tell);
}

// Copies of a file, or of a coarse clock: they do not show how much repetitions vary.
TEST(Change, RepetitionsThatAreEqualProveNothing) {
  Random random(23);
  const auto& kind = kinds().front();
  const std::vector<Summary> from(3, run_of(kind.series(3000, random))),
      to(3, run_of(kind.series(3000, random)));
  for (const auto figure : {Figure::mean, Figure::p50, Figure::p99, Figure::p99_9})
    EXPECT_EQ(change_of(from, to, figure)->verdict(), Verdict::cannot_tell) << static_cast<int>(figure);
}

TEST(Change, MeanOfRepetitionsIsTheirsAndNotOfWhatNoneOfThemSaw) {
  Random random(17);
  const auto a = repetitions(kinds().front(), 5, 1000, 0, 1, random);
  auto b = repetitions(kinds().front(), 5, 1000, 0, 2, random);
  EXPECT_EQ(change_of(a, b, Figure::mean)->verdict(), Verdict::worse);
  EXPECT_EQ(change_of({a[0], a[1]}, {b[0], b[1]}, Figure::mean)->verdict(), Verdict::cannot_tell)
      << "a stall may have missed two";
}

TEST(Change, ManyShortRunsTellAsMuchAsOneLongRun) {
  Random random(15);
  const auto a = repetitions(kinds().front(), 20, 1000, 0, 1, random);
  auto b = repetitions(kinds().front(), 20, 1000, 0, 2, random);
  EXPECT_FALSE(a.front().round_trip_certainty[Figure::p99].sure.high) << "one run alone leaves it open";
  const auto p99 = *change_of(a, b, Figure::p99);
  EXPECT_EQ(p99.verdict(), Verdict::worse);
  EXPECT_GT(*p99.ratio_lies.low, 1.85);
  EXPECT_LT(*p99.ratio_lies.high, 2.15);
}

TEST(Change, NoLossInManyRunsCountsAllTheirMessages) {
  std::vector<Summary> a(20);
  for (auto& run : a) run.lost_probability = probability(std::vector<Batch>(100, {10, 0}), 1);
  const auto found = *change_of(a, a, Figure::lost);
  EXPECT_LT(*found.difference_lies.high, 0.0005) << "0 of 20,000";
  EXPECT_GT(*found.difference_lies.low, -0.0005);
}

TEST(Change, SingleRunsGetNoVerdict) {
  Random random(16);
  const auto a = repetitions(kinds().front(), 1, 10'000, 0, 1, random),
             b = repetitions(kinds().front(), 1, 10'000, 0, 2, random);
  const auto found = *change_of(a, b, Figure::p50);
  EXPECT_EQ(found.tendency, Tendency::more) << "of these two";
  EXPECT_EQ(found.verdict(), Verdict::cannot_tell) << "the next start may be another";
}

TEST(Change, TendsToWhatItsIntervalLeaves) {
  const auto base = with_p99(between(90, 100, 110));
  const auto tendency = [&](const Measured& p99) {
    const auto run = with_p99(p99);
    return change({&base}, {&run}, Times::round_trip, Figure::p99)->tendency;
  };
  EXPECT_EQ(tendency(between(120, 130, 140)), Tendency::more);
  EXPECT_EQ(tendency(between(60, 70, 80)), Tendency::less);
  EXPECT_EQ(tendency(between(90, 105, 120)), Tendency::unclear);
  EXPECT_EQ(tendency({130, {}, {120, {}}}), Tendency::more);  // by how much is open
  EXPECT_EQ(tendency({130, {}, {{}, 140}}), Tendency::unclear);
  EXPECT_EQ(tendency({70, {}, {{}, 80}}), Tendency::less);
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

TEST(Change, RepetitionsWidenTheIntervalByTheirSpread) {
  // Each surely another than the others, by its own samples: the runs differ more than these tell.
  const std::vector<Summary> runs = {with_p99(between(99, 100, 101)),  with_p99(between(119, 120, 121)),
                                     with_p99(between(139, 140, 141)), with_p99(between(139, 140, 141)),
                                     with_p99(between(159, 160, 161)), with_p99(between(179, 180, 181))};
  const auto found =
      *change({&runs[0], &runs[1], &runs[2]}, {&runs[3], &runs[4], &runs[5]}, Times::round_trip, Figure::p99);
  EXPECT_DOUBLE_EQ(found.from, 120);
  EXPECT_DOUBLE_EQ(found.to, 160);
  // Student's t of 4 degrees at 99.5 % is 4.604, the deviation of either side 20.
  EXPECT_NEAR(*found.difference_lies.low, 40 - 4.604 * 20 * std::sqrt(2.0 / 3), 0.01);
  EXPECT_EQ(found.verdict(), Verdict::cannot_tell);
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

TEST(Change, VerdictIsThatOfTheRatiosIntervalWhereTheDifferenceSaysOtherwise) {
  const auto runs = [](std::initializer_list<double> values) {
    std::vector<Summary> all;
    for (const double value : values) all.push_back(with_p99(between(value * 0.99, value, value * 1.01)));
    return all;
  };
  // Ten times as long and more, by very different amounts.
  const auto a = runs({300, 305, 310, 315, 320}), b = runs({3000, 5000, 9000, 16'000, 30'000});
  const auto found = *change(all_of(a), all_of(b), Times::round_trip, Figure::p99);
  ASSERT_LT(*found.difference_lies.low, 0);
  ASSERT_GT(*found.ratio_lies.low, 1);
  EXPECT_EQ(found.verdict(), Verdict::worse);
  EXPECT_EQ(ratio_exceeds(found, 1.01), Answer::yes);
  EXPECT_EQ(difference_exceeds(found, 100), Answer::yes);
  // Less by the means alone: one of the five is a hundredth.
  const auto c = runs({700, 701, 702, 703, 704}), d = runs({1, 302, 303, 304, 305});
  const auto less = *change(all_of(c), all_of(d), Times::round_trip, Figure::p99);
  ASSERT_LT(*less.difference_lies.high, 0);
  ASSERT_GT(*less.ratio_lies.high, 1);
  EXPECT_EQ(less.verdict(), Verdict::cannot_tell);
  EXPECT_EQ(ratio_exceeds(*change(all_of(d), all_of(c), Times::round_trip, Figure::p99), 1.01),
            Answer::cannot_tell);
}

TEST(Change, OfSharesIsNoMoreThanAllMessages) {
  std::vector<Summary> a(2), b(2);
  const auto losing = [](Summary& run, double events) {
    run.lost_probability = probability(std::vector<Batch>(100, {10, events}), 1);
  };
  losing(a[0], 1);
  losing(a[1], 9);
  losing(b[0], 0);
  losing(b[1], 0);
  const auto less = *change_of(a, b, Figure::lost), more = *change_of(b, a, Figure::lost);
  EXPECT_FALSE(less.ratio);
  EXPECT_EQ(less.difference_lies.low, -1.0) << "two runs that differ so much bound nothing";
  EXPECT_EQ(more.difference_lies.high, 1.0);
  EXPECT_LT(*more.difference_lies.low, 0);
}

TEST(Change, MaximumIsTheGreatestOfAllRunsAndHasNoVerdict) {
  std::vector<Summary> a(3), b(3);
  for (std::size_t i = 0; i < 3; ++i) {
    a[i].round_trip.count = b[i].round_trip.count = 400;
    a[i].round_trip.max = 100 + static_cast<std::int64_t>(i);
    b[i].round_trip.max = 10'000 - static_cast<std::int64_t>(i);
  }
  const auto max = *change_of(a, b, Figure::max);
  EXPECT_EQ(max.from, 102);
  EXPECT_EQ(max.to, 10'000);
  EXPECT_NEAR(*max.ratio, 10'000.0 / 102, 1e-9);
  EXPECT_FALSE(max.ratio_lies.low || max.ratio_lies.high || max.difference_lies.low);
  EXPECT_EQ(max.tendency, Tendency::unclear);
}

TEST(Change, MaximaHaveARatioUpToATenthMoreValues) {
  std::vector<Summary> a(2), b(2);
  for (auto* runs : {&a, &b})
    for (auto& run : *runs) {
      run.round_trip.count = run.response.count = 1000;
      run.round_trip.max = run.response.max = 100;
    }
  b[1].round_trip.count = 1200;
  EXPECT_EQ(change_of(a, b, Figure::max)->ratio, 1.0) << "2,200 and 2,000";
  b[1].round_trip.count = 1201;
  for (const auto& found : {*change_of(a, b, Figure::max), *change_of(b, a, Figure::max)}) {
    EXPECT_TRUE(found.is_of_unequal_numbers);
    EXPECT_FALSE(found.ratio);
  }
  EXPECT_TRUE(change(all_of(a), all_of(b), Times::response, Figure::max)->ratio) << "as many cycles";
}

TEST(Change, PercentileOfTooFewMessagesIsUnknown) {
  Random random(17);
  const auto enough = repetitions(kinds().front(), 3, 1000, 0, 1, random),
             too_few = repetitions(kinds().front(), 3, 999, 0, 10, random);
  EXPECT_TRUE(change_of(enough, enough, Figure::p99_9));
  EXPECT_FALSE(change_of(enough, too_few, Figure::p99_9));
  EXPECT_FALSE(change_of(too_few, enough, Figure::p99_9));
  EXPECT_TRUE(change_of(enough, too_few, Figure::p99));
}

TEST(Change, EqualSharesInAnotherOrderAreNoChange) {
  const auto late = [](std::initializer_list<std::uint64_t> of_thousand) {
    std::vector<Summary> runs;
    for (const auto events : of_thousand)
      runs.emplace_back().late_probability = probability(events, 1000, 1, 1);
    return runs;
  };
  for (const auto& [from, to] :
       {std::pair(late({0, 0, 5}), late({0, 1, 4})), {late({0, 1, 4}), late({0, 0, 5})}}) {
    const auto found = *change_of(from, to, Figure::late);
    EXPECT_EQ(found.from, found.to);
    EXPECT_EQ(difference_exceeds(found, 0), Answer::no);
  }
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

// SPDX-License-Identifier: Apache-2.0
#include "statistics/course.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

namespace ontime::statistics {

void Course::add(std::int64_t value) { values_.push_back(static_cast<float>(value)); }

void Course::add_series(const Series& series) {
  if (series.count >= Values::short_series) {
    series_.emplace_back(values_.size(), series);
    return;
  }
  for (std::uint64_t i = 0; i < series.count; ++i)
    add(series.least + static_cast<std::int64_t>(i) * series.step);
}

template <class OfValues, class OfSeries>
std::vector<Batch> Course::batches(OfValues of_values, OfSeries of_series) const {
  std::vector<Batch> all(std::clamp<std::size_t>(values_.size(), 1, most_batches));
  const auto first_of = [&](std::size_t batch) { return batch * values_.size() / all.size(); };
  for (std::size_t batch = 0; batch < all.size(); ++batch) {
    const auto some = values().subspan(first_of(batch), first_of(batch + 1) - first_of(batch));
    all[batch] = {static_cast<double>(some.size()), of_values(some)};
  }
  std::size_t batch = 0;
  for (const auto& [place, series] : series_) {
    while (batch + 1 < all.size() && first_of(batch + 1) <= place) ++batch;
    all[batch].values += static_cast<double>(series.count);
    all[batch].events += of_series(series);
  }
  return all;
}

std::vector<std::vector<Batch>> Course::events(std::span<const std::int64_t> thresholds, Count count) const {
  std::vector<std::vector<Batch>> all;
  const bool above = count == Count::above;
  for (const auto threshold : thresholds) {
    const auto limit = static_cast<float>(threshold);
    all.push_back(batches(
        [&](std::span<const float> values) {
          return static_cast<double>(std::ranges::count_if(
              values, [&](float value) { return above ? value > limit : value >= limit; }));
        },
        [&](const Series& series) {
          return static_cast<double>(series.count - series.at_most(threshold - (above ? 0 : 1)));
        }));
  }
  return all;
}

std::vector<Batch> Course::sums() const {
  return batches(
      [](std::span<const float> values) { return std::accumulate(values.begin(), values.end(), 0.0); },
      [](const Series& series) { return series.sum(); });
}

namespace {

// Requirements of an interval: tests/statistics_truth_test.cpp shows how often it then holds the true value.
constexpr double fewest_beyond = 30;  // slower messages: a stall that strikes rarely may not be seen
constexpr double fewest_effective_beyond = 10;  // and so many effective ones: not of a few bursts
constexpr double fewest_effective_in_all = 30;
constexpr std::size_t fewest_of_levels = 1000, fewest_batches_of_levels = 32;
constexpr std::size_t shortest_part = 16;  // of the run
constexpr double least_difference = 0.5;   // of the shares of messages above the run's median
constexpr double surely = 5;               // standard errors, of the best of many places
constexpr double least_ratio = 1.2;        // of the medians: less is no new level
constexpr double fewest_to_tell_memory =
    50;                               // of fewer slower messages that of the percentile before counts too
constexpr double most_memory = 1.65;  // one run in twenty without any memory has more

constexpr const char* drifts = "the level drifts";
constexpr const char* few_effective = "effective sample size below 30";
constexpr const char* few_beyond = "fewer than 30 slower messages";
constexpr const char* few_bursts = "slower messages come in few bursts";

// Removes the ends that the run does not support, and gives the reason.
void keep_what_is_supported(Measured& of, double messages, double share_above, double memory) {
  const double effective = messages / of.effect;
  if (memory > most_memory || effective < fewest_effective_in_all) {
    of.sure = of.surer = {};
    of.open = memory > most_memory ? drifts : few_effective;
  } else if (messages * share_above < fewest_beyond || effective * share_above < fewest_effective_beyond) {
    of.sure.high = of.surer.high = std::nullopt;
    of.open = messages * share_above < fewest_beyond ? few_beyond : few_bursts;
  }
}

// With 95 % confidence a cause that the run has not seen affects at most 3 in n messages, times the burst
// size (rule of three); each may take as long as the time-out.
void add_the_unseen(Measured& mean, double messages, double effect, std::optional<double> longest_ns) {
  if (!longest_ns && *mean.open == '\0') mean.open = "no time-out limits these times";
  for (auto* interval : {&mean.sure, &mean.surer}) {
    if (longest_ns && interval->high)
      *interval->high += 3 * effect / messages * *longest_ns;
    else
      interval->high.reset();
  }
}

Certainty certainty_of_whole(const Course& course, Ranks& ranks, const Distribution& of,
                             std::optional<double> longest_ns) {
  const auto& thresholds = of.quantiles;
  // With many equal values, none may be above a percentile and half of all at it: use both counts.
  const auto above = course.events(thresholds, Course::Count::above);
  const auto at_or_above = course.events(thresholds, Course::Count::at_or_above);

  Certainty result;
  const auto n = static_cast<double>(of.count);
  const auto value_at = [&](std::optional<double> share, bool upper) -> std::optional<double> {
    if (!share) return {};
    const auto rank = upper ? std::ceil(*share * n) : std::floor(*share * n);
    return static_cast<double>(ranks.at_rank(static_cast<std::uint64_t>(std::clamp(rank, 1.0, n))));
  };
  double before = 1, remembered = 0;
  for (std::size_t i = 0; i < percentiles.size(); ++i) {
    const double share = 1 - percentiles[i].share_above();
    auto& measured = result.quantiles[i];
    measured.value = static_cast<double>(thresholds[i]);
    measured.effect = before = std::max(tail_effect(above[i], before), tail_effect(at_or_above[i], before));
    for (const auto& [confidence, interval] : {std::pair{0.95, &measured.sure}, {0.98, &measured.surer}}) {
      const auto shares = quantile_shares(share, n / measured.effect, confidence);
      *interval = {value_at(shares.low, false), value_at(shares.high, true)};
    }
    const double own = std::max(memory(above[i]), memory(at_or_above[i]));
    const bool tells_its_own = n * (1 - share) / measured.effect >= fewest_to_tell_memory;
    remembered = tells_its_own ? own : std::max(own, remembered);
    keep_what_is_supported(measured, n, percentiles[i].share_above(), remembered);
  }
  result.slowest_effect = slowest_effect(std::array{above[3], above[2], above[1]});  // p99.9, p99, p90
  const auto sums = course.sums();
  result.mean = mean(sums, of.mean);
  // No time is below 0, whatever the normal distribution of batch means says of a few huge values; that the
  // true mean is within stays as probable. The least time seen is no such bound: a run may miss a faster one.
  // Ages by two clocks may be below 0.
  if (of.min >= 0)
    for (auto* interval : {&result.mean.sure, &result.mean.surer})
      if (interval->low) interval->low = std::max(*interval->low, 0.0);
  add_the_unseen(result.mean, n, result.slowest_effect, longest_ns);
  if (memory(sums) > most_memory) {
    result.mean.sure = result.mean.surer = {};
    result.mean.open = drifts;
  }
  return result;
}

Certainty certainty_of_part(std::span<const float> values, std::optional<double> longest_ns) {
  Values all;
  Course course;
  for (const auto value : values) {
    all.add(std::llround(value));
    course.add(std::llround(value));
  }
  Ranks ranks(std::move(all));
  return certainty_of_whole(course, ranks, ranks.distribution(), longest_ns);
}

// Where the median may have changed for good: the place between two batches from which on the share of slower
// values differs most from that before (cumulative sums), if no chance makes such a difference.
std::optional<double> change_of_level(std::span<const Batch> batches) {
  const auto n = batches.size();
  if (n < fewest_batches_of_levels) return {};
  const auto all = sum_of(batches);
  double sum = 0, greatest = 0;
  std::size_t place = 0;
  for (std::size_t i = 0; i < n; ++i) {
    sum += batches[i].events - all.events / all.values * batches[i].values;
    if (std::abs(sum) <= greatest || i + 1 < n / shortest_part || i + 1 > n - n / shortest_part) continue;
    greatest = std::abs(sum);
    place = i + 1;
  }
  if (place == 0) return {};
  const auto before = probability(batches.first(place), 1), after = probability(batches.subspan(place), 1);
  const auto variance = [](const Probability& of) {
    const double effective = static_cast<double>(of.messages) / of.effect;
    const double share = (of.value * effective + 1) / (effective + 2);  // never surely 0
    return share * (1 - share) / effective;
  };
  const double difference = std::abs(after.value - before.value);
  if (difference < least_difference || difference < surely * std::sqrt(variance(before) + variance(after)))
    return {};
  return static_cast<double>(place) / static_cast<double>(n);
}

// The widest interval of both parts: it also holds for a mixture of them.
Measured hull(Measured whole, const Measured& one, const Measured& other) {
  const auto widest = [](const Interval& a, const Interval& b) {
    Interval both;
    if (a.low && b.low) both.low = std::min(*a.low, *b.low);
    if (a.high && b.high) both.high = std::max(*a.high, *b.high);
    return both;
  };
  whole.sure = widest(one.sure, other.sure);
  whole.surer = widest(one.surer, other.surer);
  whole.open = *one.open != '\0' ? one.open : other.open;
  return whole;
}

}  // namespace

Certainty certainty(const Course& course, Ranks& ranks, const Distribution& of,
                    std::optional<double> longest_ns) {
  auto result = certainty_of_whole(course, ranks, of, longest_ns);
  const std::array median = {of[Figure::p50]};
  const auto values = course.values();
  if (course.has_series() || values.size() < fewest_of_levels) return result;
  const auto changed = change_of_level(course.events(median, Course::Count::above).front());
  if (!changed) return result;
  const auto place = static_cast<std::size_t>(*changed * static_cast<double>(values.size()));
  const auto before = certainty_of_part(values.first(place), longest_ns);
  const auto after = certainty_of_part(values.subspan(place), longest_ns);
  const double was_ns = before[Figure::p50].value, is_ns = after[Figure::p50].value, ratio = is_ns / was_ns;
  if (!(was_ns > 0) || (ratio < least_ratio && ratio > 1 / least_ratio)) return result;
  result.shift = Shift{*changed, was_ns, is_ns};
  result.mean = hull(result.mean, before.mean, after.mean);
  for (const auto& row : percentiles)
    result[row.figure] = hull(result[row.figure], before[row.figure], after[row.figure]);
  return result;
}

}  // namespace ontime::statistics

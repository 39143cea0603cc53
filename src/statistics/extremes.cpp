// SPDX-License-Identifier: Apache-2.0
#include "statistics/extremes.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <random>
#include <utility>

#include <boost/math/distributions/binomial.hpp>
#include <boost/math/distributions/normal.hpp>
#include <fmt/format.h>

namespace ontime::statistics {
namespace {

constexpr std::size_t blocks = 100;
constexpr std::size_t fewest_values = 1000;
constexpr std::size_t fewest_peaks = 30;
constexpr double fewest_effective_slowest =
    10;  // values above a threshold: fewer do not show how they cluster
constexpr int resamples = 400;
// Of a percentile bootstrap so many hold what is asked of them at 95 %: tests/statistics_extremes_test.cpp.
constexpr double middle = 0.98, confidence = 0.95;
constexpr double one_in_a_million = 1e-6;
constexpr double surely_seen = 4;  // times as often as once in the run: then 98 of 100 runs have seen it
constexpr double refuses = 0.01, refuses_fit = 0.05;
constexpr double heaviest = 0.5;  // beyond, L-moments tell little of the shape: their variance is infinite

double two_sided(double deviate) { return std::erfc(std::abs(deviate) / std::sqrt(2.0)); }

double anderson_darling(std::vector<double> values, const Tail& tail) {
  std::sort(values.begin(), values.end());
  const auto n = values.size();
  double sum = 0;
  const auto inside = [&](double x) { return std::clamp(tail.below(x), 1e-15, 1 - 1e-15); };
  for (std::size_t i = 0; i < n; ++i)
    sum += static_cast<double>(2 * i + 1) *
           (std::log(inside(values[i])) + std::log1p(-inside(values[n - 1 - i])));
  return -static_cast<double>(n) - sum / static_cast<double>(n);
}

using Fit = std::function<std::optional<Tail>(std::vector<double>)>;
using Level = std::function<double(const Tail&)>;

Interval middle_of(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const auto at = [&](double share) {
    return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
  };
  return {at((1 - middle) / 2), at((1 + middle) / 2)};
}

// A share that is 1 of a round number: 1 in 400.
double rounded_up(double share) {
  const double one_in = 1 / share, digit = std::pow(10, std::floor(std::log10(one_in)));
  return 1 / (std::floor(one_in / digit * (1 + 1e-9)) * digit);
}

// What the order of `values` tells of the level that `exceedance` of them exceed.
Interval by_order(std::span<const float> values, double exceedance, double effective) {
  std::vector<float> sorted(values.begin(), values.end());
  std::sort(sorted.begin(), sorted.end());
  const auto n = static_cast<double>(sorted.size());
  const auto at = [&](double rank) {
    return static_cast<double>(sorted[static_cast<std::size_t>(std::clamp(rank, 1.0, n)) - 1]);
  };
  const auto shares = quantile_shares(1 - exceedance, effective, confidence);
  Interval lies;
  if (shares.low) lies.low = at(std::floor(*shares.low * n));
  if (shares.high) lies.high = at(std::ceil(*shares.high * n));
  return lies;
}

std::optional<Bound> bound(const std::vector<double>& values, const Fit& fit, const Level& level) {
  const auto tail = fit(values);
  if (!tail) return {};
  Bound result;
  result.tail = *tail;
  result.level = level(*tail);
  result.count = values.size();
  const double distance = anderson_darling(values, *tail);
  std::mt19937_64 random(1);
  std::vector<double> shapes, levels;
  int further = 0;
  for (int i = 0; i < resamples; ++i) {
    std::vector<double> sample(values.size());
    for (auto& value : sample) value = tail->quantile((static_cast<double>(random() >> 11) + 0.5) * 0x1p-53);
    const auto again = fit(sample);
    if (!again) continue;
    shapes.push_back(again->shape);
    levels.push_back(level(*again));
    further += anderson_darling(std::move(sample), *again) >= distance ? 1 : 0;
  }
  if (shapes.empty()) return {};
  result.fit_p =
      (further + 1.0) / (static_cast<double>(shapes.size()) + 1.0);  // what was found is one of them
  result.shape_lies = middle_of(std::move(shapes));
  result.level_lies = middle_of(std::move(levels));
  if (tail->shape > heaviest)
    result.refused = fmt::format("its tail is too heavy (shape {:.2f})", tail->shape);
  else if (result.fit_p < refuses_fit)
    result.refused = fmt::format(
        "the slowest answers do not follow an extreme-value distribution (Anderson-Darling, p = {})",
        p_text(result.fit_p));
  return result;
}

// Where the greatest of each run of peaks is: the longest gaps lie between runs (Ferro & Segers 2003).
std::vector<std::size_t> declustered(const std::vector<std::size_t>& places, std::span<const float> values,
                                     double index) {
  std::vector<std::size_t> gaps;
  for (std::size_t i = 1; i < places.size(); ++i) gaps.push_back(places[i] - places[i - 1]);
  auto longest_first = gaps;
  std::sort(longest_first.begin(), longest_first.end(), std::greater<>());
  const auto clusters =
      std::max<std::size_t>(1, static_cast<std::size_t>(index * static_cast<double>(places.size())));
  // As many of the longest as lie between so many clusters, or, where the next is as long, those longer.
  const auto longest_within = clusters > gaps.size() ? 0 : longest_first[clusters - 1];
  std::vector<std::size_t> peaks;
  for (std::size_t i = 0; i < places.size(); ++i) {
    if (i == 0 || gaps[i - 1] > longest_within)
      peaks.push_back(places[i]);
    else if (values[places[i]] > values[peaks.back()])
      peaks.back() = places[i];
  }
  return peaks;
}

// Of the values from `least` on.
double effective_from(std::span<const float> values, float least) {
  Batches batches;
  for (const auto value : values) batches.add(value >= least);
  const auto all = batches.all();
  return sum_of(all).events / design_effect(all);
}

// Levels beyond the threshold may cluster more: what a fifth of its peaks pass shows some of it.
bool are_of_few_bursts(std::span<const float> values, const std::vector<std::size_t>& places,
                       float threshold) {
  std::vector<float> slowest;
  slowest.reserve(places.size());
  for (const auto place : places) slowest.push_back(values[place]);
  const auto least = std::nextafter(threshold, std::numeric_limits<float>::infinity());
  auto rarer = least;
  if (const auto fifth = std::max(fewest_peaks, slowest.size() / 5); fifth < slowest.size()) {
    const auto at = slowest.begin() + static_cast<std::ptrdiff_t>(fifth);
    std::nth_element(slowest.begin(), at, slowest.end(), std::greater<>());
    rarer = *at;
  }
  return std::min(effective_from(values, least), effective_from(values, rarer)) < fewest_effective_slowest;
}

// p-value of an even split over the two halves of the run.
double halves_p(std::size_t first, std::size_t second) {
  const boost::math::binomial fair(static_cast<double>(first + second), 0.5);
  return std::min(1.0, 2 * boost::math::cdf(fair, static_cast<double>(std::min(first, second))));
}

std::string unsteady(const Extremes& of, std::size_t first, std::size_t second) {
  if (of.trend_p < refuses)
    return fmt::format("the slowest answers have a trend over the run (Mann-Kendall, p = {})",
                       p_text(of.trend_p));
  if (of.runs_p < refuses)
    return fmt::format("slow stretches follow one another (Wald-Wolfowitz, p = {})", p_text(of.runs_p));
  if (of.halves_p < refuses)
    return fmt::format("slow stretches differ between the halves of the run (first {}, second {}, p = {})",
                       first, second, p_text(of.halves_p));
  return "";
}

}  // namespace

std::string p_text(double p) {
  if (p < 1e-9) return fmt::format("{:.2g}", p);
  const double unit = std::pow(10, std::floor(std::log10(p)) - 1);
  return fmt::format("{:.2g}", std::floor(p / unit * (1 + 1e-9)) * unit);
}

double trend_p(std::span<const double> values) {
  const auto n = static_cast<double>(values.size());
  double score = 0;
  std::map<double, double> alike;
  for (std::size_t i = 0; i < values.size(); ++i) {
    ++alike[values[i]];
    for (std::size_t k = 0; k < i; ++k)
      score += (values[i] > values[k] ? 1 : 0) - (values[i] < values[k] ? 1 : 0);
  }
  double variance = n * (n - 1) * (2 * n + 5);
  for (const auto& [value, count] : alike) variance -= count * (count - 1) * (2 * count + 5);
  if (variance <= 0 || score == 0) return 1;
  return two_sided((std::abs(score) - 1) / std::sqrt(variance / 18));
}

double runs_p(std::span<const double> values) {
  std::vector<double> sorted(values.begin(), values.end());
  if (sorted.empty()) return 1;
  std::sort(sorted.begin(), sorted.end());
  const double median = sorted[sorted.size() / 2];
  double above = 0, below = 0, runs = 0;
  std::optional<bool> last;
  for (const auto value : values) {
    const bool is_above = value >= median;
    (is_above ? above : below) += 1;
    if (last != is_above) ++runs;
    last = is_above;
  }
  const double n = above + below, product = 2 * above * below;
  const double variance = product * (product - n) / (n * n * (n - 1));
  if (!(variance > 0)) return 1;
  return boost::math::cdf(boost::math::normal(), (runs - product / n - 1 + 0.5) / std::sqrt(variance));
}

double extremal_index(std::span<const std::size_t> places) {
  double sum = 0, squares = 0, longest = 0, less_one = 0, products = 0;
  const auto gaps = places.size() < 2 ? 0 : places.size() - 1;
  for (std::size_t i = 0; i < gaps; ++i) {
    const auto gap = static_cast<double>(places[i + 1] - places[i]);
    longest = std::max(longest, gap);
    sum += gap;
    squares += gap * gap;
    less_one += gap - 1;
    products += (gap - 1) * (gap - 2);
  }
  if (gaps == 0) return 1;
  const auto n = static_cast<double>(gaps);
  return std::min(1.0,
                  longest <= 2 ? 2 * sum * sum / (n * squares) : 2 * less_one * less_one / (n * products));
}

Extremes extremes(std::span<const float> values, float threshold) {
  Extremes result;
  if (values.size() < fewest_values) {
    result.refused = fmt::format("too few answers (needed {}, found {})", fewest_values, values.size());
    return result;
  }
  const auto n = static_cast<double>(values.size());
  std::vector<double> maxima;
  for (std::size_t i = 0; i < blocks; ++i) {
    const auto from = i * values.size() / blocks, to = (i + 1) * values.size() / blocks;
    const auto block = values.subspan(from, to - from);
    maxima.push_back(static_cast<double>(*std::max_element(block.begin(), block.end())));
  }
  std::vector<std::size_t> places;
  for (std::size_t i = 0; i < values.size(); ++i)
    if (values[i] > threshold) places.push_back(i);
  result.index = extremal_index(places);
  const auto peaks = declustered(places, values, result.index);
  std::vector<double> greatest;
  greatest.reserve(peaks.size());
  for (const auto place : peaks) greatest.push_back(static_cast<double>(values[place]));

  const double clusters = n * result.index;
  result.exceedance = std::max(one_in_a_million, rounded_up(std::min(0.1, surely_seen / clusters)));
  result.answers_for_a_million = surely_seen / one_in_a_million / result.index;
  const double a_block = n / static_cast<double>(blocks) * result.index;
  result.maxima = bound(maxima, fit_maxima, [&](const Tail& tail) {
    return tail.quantile(std::exp(-result.exceedance * a_block));
  });
  const double passing = static_cast<double>(places.size()) / n;
  if (peaks.size() >= fewest_peaks)
    result.peaks = bound(
        greatest,
        [=](std::vector<double> some) { return fit_peaks(std::move(some), static_cast<double>(threshold)); },
        [&](const Tail& tail) { return tail.quantile(std::max(0.0, 1 - result.exceedance / passing)); });
  const auto ordered = by_order(values, result.exceedance, clusters);
  for (auto* bound : {&result.maxima, &result.peaks}) {
    if (!*bound) continue;
    auto& lies = (*bound)->level_lies;
    lies.low = std::min(*lies.low, ordered.low.value_or(*lies.low));
    lies.high = std::max(*lies.high, ordered.high.value_or(*lies.high));
  }
  if (!result.maxima && !result.peaks)
    result.refused = "the slowest answers are all equal, or all of one burst";
  result.trend_p = trend_p(maxima);
  result.runs_p = runs_p(maxima);
  const auto half = std::lower_bound(peaks.begin(), peaks.end(), values.size() / 2);
  const auto first = static_cast<std::size_t>(half - peaks.begin()), second = peaks.size() - first;
  result.halves_p = halves_p(first, second);
  auto why = unsteady(result, first, second);
  if (why.empty() && are_of_few_bursts(values, places, threshold))
    why = "the slowest answers come in few bursts";
  for (auto* bound : {&result.maxima, &result.peaks})
    if (*bound && !why.empty()) (*bound)->refused = why;
  return result;
}

}  // namespace ontime::statistics

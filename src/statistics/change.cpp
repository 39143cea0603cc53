// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>

#include <boost/math/distributions/binomial.hpp>
#include <boost/math/distributions/students_t.hpp>

#include "statistics/statistics.hpp"

namespace ontime::statistics {
namespace {

constexpr double infinite = std::numeric_limits<double>::infinity();
// Measured::surer has 0.99 a side. What differs between runs is seldom normal: of equal runs on a busy
// machine Student's t with 0.99 failed up to two in a hundred gates.
constexpr double one_sided = 0.995, one_sided_of_unequal = 0.99;

// A metric of one or several runs: their mean, how far below and above it the true one may lie by what the
// samples tell, and how much the runs differ.
struct Side {
  double value = 0, below = 0, above = 0;
  double squares = 0;  // of the differences from the mean
  double runs = 0;
};

using Scale = double (*)(double);

double below(const Measured& one, Scale scale) {
  return one.surer.low ? scale(one.value) - scale(*one.surer.low) : infinite;
}
double above(const Measured& one, Scale scale) {
  return one.surer.high ? scale(*one.surer.high) - scale(one.value) : infinite;
}

Side side_of(const std::vector<Measured>& runs, Scale scale) {
  Side side;
  side.runs = static_cast<double>(runs.size());
  for (const auto& run : runs) side.value += scale(run.value) / side.runs;
  for (const auto& run : runs) {
    side.below += std::pow(below(run, scale), 2);
    side.above += std::pow(above(run, scale), 2);
    side.squares += std::pow(scale(run.value) - side.value, 2);
  }
  side.below = std::sqrt(side.below) / side.runs;
  side.above = std::sqrt(side.above) / side.runs;
  return side;
}

bool are_repeated(const Side& from, const Side& to) { return from.runs > 1 && to.runs > 1; }

// Of the difference, as far as the spread of the runs tells, if there are more than two. The variance of both
// together (Student) is too small where the side with fewer runs varies more: then that of each alone counts
// (Welch 1947).
double between_runs(const Side& from, const Side& to) {
  const auto deviate = [](double degrees, double share) {
    return boost::math::quantile(boost::math::students_t(degrees), share);
  };
  const double degrees = from.runs + to.runs - 2;
  const double variance = (from.squares + to.squares) / degrees * (1 / from.runs + 1 / to.runs);
  const double together = deviate(degrees, one_sided) * std::sqrt(variance);
  if (!are_repeated(from, to) || variance <= 0) return together;
  const auto of_mean = [](const Side& side) { return side.squares / (side.runs - 1) / side.runs; };
  const double one = of_mean(from), other = of_mean(to);
  const double own_degrees =
      std::pow(one + other, 2) / (std::pow(one, 2) / (from.runs - 1) + std::pow(other, 2) / (to.runs - 1));
  return std::max(together, deviate(own_degrees, one_sided_of_unequal) * std::sqrt(one + other));
}

// Whether the runs alone may decide, where the samples of single ones give no limit. Such a percentile can
// have one of two values, as slow answers were just more or less than it takes: then the runs of a side may
// be almost equal by chance. But in equal conditions, all of one side are rarely beyond all of the other.
bool are_enough(std::size_t from, std::size_t to) {
  constexpr double at_most = 0.02;  // of both directions, as the interval
  const auto [fewer, more] = std::minmax(from, to);
  double ways = 1;  // to choose the runs of one side from all: a binomial coefficient
  for (std::size_t i = 1; fewer > 1 && i <= fewer; ++i) {
    ways *= static_cast<double>(more + i) / static_cast<double>(i);
    if (2 / ways <= at_most) return true;
  }
  return false;
}

Interval difference_lies(const Side& from, const Side& to, bool runs_decide) {
  const double value = to.value - from.value;
  double below = std::hypot(to.below, from.above), above = std::hypot(to.above, from.below);
  if (from.runs + to.runs > 2) {
    const double between = between_runs(from, to);
    // What one run leaves open is part of what makes its repetitions differ. Equal ones do not tell how much:
    // they are copies, or of a coarse clock.
    const double rounding = 1e-9 * std::max(std::abs(from.value), std::abs(to.value));
    const bool suffices = runs_decide && between > rounding;
    below = suffices && !std::isfinite(below) ? between : std::max(below, between);
    above = suffices && !std::isfinite(above) ? between : std::max(above, between);
  }
  Interval interval;
  if (std::isfinite(below)) interval.low = value - below;
  if (std::isfinite(above)) interval.high = value + above;
  return interval;
}

// What is known of one side. Of late and lost messages those of all runs are counted together: none in twenty
// runs is twenty times as much as none in one.
struct Known {
  std::vector<Measured> runs;
  std::optional<Probability> pooled;
  double values = 0;  // of all runs

  double greatest() const { return std::ranges::max(runs, {}, &Measured::value).value; }
  Side side(Scale scale) const {
    auto side = side_of(runs, scale);
    if (!pooled) return side;
    side.below = below(*pooled, scale);
    side.above = above(*pooled, scale);
    return side;
  }
};

Known known_of(const std::vector<const Summary*>& runs, Times times, Figure figure) {
  Known known;
  std::vector<Probability> shares;
  for (const auto* run : runs) {
    if (const auto one = measured(*run, times, figure)) {
      // Of fewer values than the percentile takes it is the maximum by another name.
      const auto values = (times == Times::response ? run->response : run->round_trip).count;
      if (values < metric_of(figure).one_in) return {};
      known.values += static_cast<double>(values);
      known.runs.push_back(*one);
    }
    if (const auto* share = probability_of(*run, times, figure)) shares.push_back(*share);
  }
  if (shares.size() > 1) known.pooled = pooled(shares);
  return known;
}

void set_ratio(Change& change, const Known& from, const Known& to, bool runs_decide) {
  const auto positive = [](const Measured& one) { return one.value > 0; };
  if (!std::ranges::all_of(from.runs, positive) || !std::ranges::all_of(to.runs, positive)) return;
  const auto log = [](double value) { return value > 0 ? std::log(value) : -infinite; };
  change.ratio = change.to / change.from;
  // Of the geometric means, which may lie elsewhere where repetitions differ much.
  const auto lies = difference_lies(from.side(log), to.side(log), runs_decide);
  if (lies.low) change.ratio_lies.low = std::min(std::exp(*lies.low), *change.ratio);
  if (lies.high) change.ratio_lies.high = std::max(std::exp(*lies.high), *change.ratio);
}

bool is_above(const Interval& lies, double limit) { return lies.low && *lies.low > limit; }

}  // namespace

const Probability* probability_of(const Summary& summary, Times times, Figure figure) {
  if (figure == Figure::lost) return &summary.lost_probability;
  if (figure != Figure::late) return nullptr;
  return times == Times::response ? &summary.late_by_response_probability : &summary.late_probability;
}

std::optional<Measured> measured(const Summary& summary, Times times, Figure figure) {
  if (const auto* share = probability_of(summary, times, figure))
    return share->messages > 0 ? std::optional<Measured>(*share) : std::nullopt;
  const bool by_response = times == Times::response;
  const auto& distribution = by_response ? summary.response : summary.round_trip;
  if (distribution.count == 0) return {};
  const auto& certainty = by_response ? summary.response_certainty : summary.round_trip_certainty;
  if (figure == Figure::max) return Measured{static_cast<double>(distribution.max), {}, {}};
  return certainty[figure];
}

Between slower_than(const Summary& summary, Times times, double limit_ns) {
  const bool by_response = times == Times::response;
  const auto& certainty = by_response ? summary.response_certainty : summary.round_trip_certainty;
  const auto answers = (by_response ? summary.response : summary.round_trip).count;
  const auto& ranks = by_response ? summary.shape.response_ranks : summary.shape.round_trip_ranks;
  const auto above = std::ranges::upper_bound(
      ranks, limit_ns, {}, [](const Ranked& one) { return static_cast<double>(one.value); });
  auto least = above == ranks.end() ? 0 : answers - above->rank + 1;
  auto most = above == ranks.begin() ? answers : answers - std::prev(above)->rank;
  const auto& asked = summary.run.asked;
  const auto all =
      std::max(asked.is_listened() ? 0 : summary.sent + (by_response ? summary.skipped_cycles : 0), answers);
  const auto unanswered = all - answers;
  most += unanswered;
  if (static_cast<double>(asked.task.client.timeout.count()) >= limit_ns) least += unanswered;
  double effect = 1;
  for (const auto& percentile : certainty.quantiles) {
    if (percentile.value <= limit_ns) effect = 1;  // only those around it count
    effect = std::max(effect, percentile.effect);
    if (percentile.value > limit_ns) break;
  }
  if (unanswered > 0) effect = std::max(effect, summary.lost_probability.effect);
  const auto share = [&](std::uint64_t events) {
    return probability(events, all, events == 0 ? 1 : effect, certainty.slowest_effect);
  };
  return {share(least), share(most), unanswered};
}

std::optional<Change> change(const std::vector<const Summary*>& from, const std::vector<const Summary*>& to,
                             Times times, Figure figure) {
  auto before = known_of(from, times, figure), after = known_of(to, times, figure);
  if (before.runs.empty() || after.runs.empty()) return {};
  // The interval of one run's mean allows for a message as late as the time-out that it did not see. What
  // several runs did not see is no change; two may both have missed it.
  const bool is_mean_of_several = figure == Figure::mean && before.runs.size() > 2 && after.runs.size() > 2;
  const bool runs_decide = is_mean_of_several || are_enough(before.runs.size(), after.runs.size());
  if (is_mean_of_several)
    for (auto* known : {&before, &after})
      for (auto& run : known->runs) run.surer = {};
  const auto as_it_is = [](double value) { return value; };
  const auto one = before.side(as_it_is), other = after.side(as_it_is);
  Change change;
  change.repeated = are_repeated(one, other);
  if (figure == Figure::max) {  // a single message's: repetitions show another message, not its spread
    change.from = before.greatest();
    change.to = after.greatest();
    // A tenth more has the greater maximum in 52 % of cases instead of 50 %, twice as many in 67 %.
    constexpr double alike = 1.1;
    const auto [fewer, more] = std::minmax(before.values, after.values);
    change.is_of_unequal_numbers = more > alike * fewer;
    if (change.from > 0 && change.to > 0 && !change.is_of_unequal_numbers)
      change.ratio = change.to / change.from;
    return change;
  }
  change.from = one.value;
  // Equal means, of other values, may differ by their rounding.
  const bool is_rounding = std::abs(other.value - one.value) <= 1e-12 * std::abs(one.value);
  change.to = is_rounding ? one.value : other.value;
  change.difference_lies = difference_lies(one, other, runs_decide);
  if (metric_of(figure).is_share)
    for (auto* end : {&change.difference_lies.low, &change.difference_lies.high})
      if (*end) *end = std::clamp(**end, -1.0, 1.0);
  set_ratio(change, before, after, runs_decide);
  const auto& lies = change.lies();
  const double same = change.ratio ? 1 : 0;
  if (is_above(lies, same)) change.tendency = Tendency::more;
  if (lies.high.value_or(same) < same) change.tendency = Tendency::less;
  return change;
}

Verdict Change::verdict() const {
  if (!repeated || tendency == Tendency::unclear) return Verdict::cannot_tell;
  return tendency == Tendency::more ? Verdict::worse : Verdict::better;
}

Answer ratio_exceeds(const Change& change, double limit) {
  if (!change.ratio) return Answer::cannot_tell;
  if (*change.ratio <= limit) return Answer::no;
  return is_above(change.ratio_lies, std::min(limit, 1.0)) ? Answer::yes : Answer::cannot_tell;
}

Answer difference_exceeds(const Change& change, double limit) {
  if (change.ratio) return ratio_exceeds(change, 1 + limit / change.from);
  if (change.to - change.from <= limit) return Answer::no;
  return is_above(change.difference_lies, std::min(limit, 0.0)) ? Answer::yes : Answer::cannot_tell;
}

Answer exceeds(const Measured& figure, double limit) {
  if (is_above(figure.surer, limit)) return Answer::yes;
  return figure.surer.high && *figure.surer.high <= limit ? Answer::no : Answer::cannot_tell;
}

std::optional<Estimate> estimate(std::vector<double> values) {
  if (values.empty()) return {};
  std::sort(values.begin(), values.end());
  const auto n = values.size();
  Estimate result;
  result.count = n;
  result.median = n % 2 == 1 ? values[n / 2] : (values[n / 2 - 1] + values[n / 2]) / 2;
  // Between the k-th smallest and the k-th largest lies the median unless fewer than k values fell on one
  // side of it: confidence = 1 - 2 P(X < k), X ~ binomial(n, 1/2).
  const boost::math::binomial fair(static_cast<double>(n), 0.5);
  const auto confidence = [&](std::size_t k) {
    return 1 - 2 * boost::math::cdf(fair, static_cast<double>(k) - 1);
  };
  std::size_t k = 1;
  while (k < n / 2 && confidence(k + 1) >= 0.95) ++k;
  result.low = values[k - 1];
  result.high = values[n - k];
  result.confidence = std::max(0.0, confidence(k));
  return result;
}

}  // namespace ontime::statistics

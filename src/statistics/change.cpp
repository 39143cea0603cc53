// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <limits>

#include <boost/math/distributions/students_t.hpp>

#include "statistics/statistics.hpp"

namespace ontime::statistics {
namespace {

constexpr double infinite = std::numeric_limits<double>::infinity();
constexpr double one_sided = 0.99;  // of Measured::surer

// A figure of one or several runs: their mean, how far below and above it the true one may lie by what the
// samples tell, and how much the runs differ.
struct Side {
  double value = 0, below = 0, above = 0;
  double squares = 0;  // of the differences from the mean
  double runs = 0;
};

Side side_of(const std::vector<Measured>& figures, double (*scale)(double)) {
  Side side;
  side.runs = static_cast<double>(figures.size());
  for (const auto& figure : figures) side.value += scale(figure.value) / side.runs;
  for (const auto& figure : figures) {
    const double value = scale(figure.value);
    const auto &low = figure.surer.low, &high = figure.surer.high;
    const double below = low ? value - scale(*low) : infinite, above = high ? scale(*high) - value : infinite;
    side.below += below * below;
    side.above += above * above;
    side.squares += std::pow(value - side.value, 2);
  }
  side.below = std::sqrt(side.below) / side.runs;
  side.above = std::sqrt(side.above) / side.runs;
  return side;
}

Interval difference_lies(const Side& from, const Side& to) {
  const double value = to.value - from.value;
  double below = std::hypot(to.below, from.above), above = std::hypot(to.above, from.below);
  if (const double degrees = from.runs + to.runs - 2; degrees > 0) {
    const double variance = (from.squares + to.squares) / degrees * (1 / from.runs + 1 / to.runs);
    const double between_runs =
        boost::math::quantile(boost::math::students_t(degrees), one_sided) * std::sqrt(variance);
    below = std::max(below, between_runs);
    above = std::max(above, between_runs);
  }
  Interval interval;
  if (std::isfinite(below)) interval.low = value - below;
  if (std::isfinite(above)) interval.high = value + above;
  return interval;
}

void set_ratio(Change& change, const std::vector<Measured>& from, const std::vector<Measured>& to) {
  const auto positive = [](const Measured& figure) { return figure.value > 0; };
  if (!std::all_of(from.begin(), from.end(), positive) || !std::all_of(to.begin(), to.end(), positive))
    return;
  const auto log = [](double value) { return value > 0 ? std::log(value) : -infinite; };
  const auto one = side_of(from, log), other = side_of(to, log);
  change.ratio = change.to / change.from;
  // Of the geometric means, which may lie elsewhere where repetitions differ much.
  const auto lies = difference_lies(one, other);
  if (lies.low) change.ratio_lies.low = std::min(std::exp(*lies.low), *change.ratio);
  if (lies.high) change.ratio_lies.high = std::max(std::exp(*lies.high), *change.ratio);
}

std::vector<Measured> measured_of(const std::vector<const Summary*>& runs, Times times, Figure figure) {
  std::vector<Measured> all;
  for (const auto* run : runs)
    if (const auto one = measured(*run, times, figure)) all.push_back(*one);
  return all;
}

bool is_above(const Interval& lies, double limit) { return lies.low && *lies.low > limit; }

}  // namespace

std::optional<Measured> measured(const Summary& summary, Times times, Figure figure) {
  const bool by_response = times == Times::response;
  const auto optional = [](const Probability& probability) -> std::optional<Measured> {
    return probability.messages > 0 ? std::optional<Measured>(probability) : std::nullopt;
  };
  if (figure == Figure::lost) return optional(summary.lost_probability);
  if (figure == Figure::late)
    return optional(by_response ? summary.late_by_response_probability : summary.late_probability);
  const auto& distribution = by_response ? summary.response : summary.round_trip;
  if (distribution.count == 0) return {};
  const auto& certainty = by_response ? summary.response_certainty : summary.round_trip_certainty;
  switch (figure) {
    case Figure::mean:
      return certainty.mean;
    case Figure::p50:
      return certainty.p50;
    case Figure::p90:
      return certainty.p90;
    case Figure::p99:
      return certainty.p99;
    case Figure::p99_9:
      return certainty.p99_9;
    case Figure::p99_99:
      return certainty.p99_99;
    default:
      return Measured{static_cast<double>(distribution.max), {}, {}};
  }
}

std::optional<Change> change(const std::vector<const Summary*>& from, const std::vector<const Summary*>& to,
                             Times times, Figure figure) {
  const auto before = measured_of(from, times, figure), after = measured_of(to, times, figure);
  if (before.empty() || after.empty()) return {};
  const auto as_it_is = [](double value) { return value; };
  const auto one = side_of(before, as_it_is), other = side_of(after, as_it_is);
  Change change;
  change.from = one.value;
  change.to = other.value;
  change.difference_lies = difference_lies(one, other);
  set_ratio(change, before, after);
  if (is_above(change.difference_lies, 0)) change.verdict = Verdict::worse;
  if (change.difference_lies.high.value_or(0) < 0) change.verdict = Verdict::better;
  return change;
}

Answer ratio_exceeds(const Change& change, double limit) {
  if (!change.ratio) return Answer::cannot_tell;
  if (*change.ratio <= limit) return Answer::no;
  return is_above(change.ratio_lies, std::min(limit, 1.0)) ? Answer::yes : Answer::cannot_tell;
}

Answer difference_exceeds(const Change& change, double limit) {
  if (change.to - change.from <= limit) return Answer::no;
  return is_above(change.difference_lies, std::min(limit, 0.0)) ? Answer::yes : Answer::cannot_tell;
}

Answer exceeds(const Measured& figure, double limit) {
  if (is_above(figure.surer, limit)) return Answer::yes;
  return figure.surer.high && *figure.surer.high <= limit ? Answer::no : Answer::cannot_tell;
}

}  // namespace ontime::statistics

// SPDX-License-Identifier: Apache-2.0
#include "search/evidence.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <utility>

namespace ontime::search {
namespace {

// Without events an alternative of 0 has a likelihood; with events it has none.
double term(double count, double factor) { return count > 0 ? count * std::log(factor) : 0; }

double likelihood_ratio(const Count& count, double share, double alternative) {
  return std::exp(term(count.events, alternative / share) +
                  term(count.messages - count.events, (1 - alternative) / (1 - share)));
}

// Counts of runs as a negative binomial distribution: Poisson counts, with rates that differ from run to run
// as a gamma distribution of `shape`, the inverse of their relative variance. Without the factor x!.
class LogLikelihood {
 public:
  LogLikelihood(const Counts& runs, double shape) : runs_(runs), shape_(shape) {
    for (const auto& run : runs)
      if (run.events > 0)
        of_counts_ += std::lgamma(run.events + shape) - std::lgamma(shape);  // NOLINT(concurrency-mt-unsafe)
  }

  double of(double share) const {
    auto sum = of_counts_;
    for (const auto& run : runs_) {
      const auto expected = share * run.messages;
      sum -= shape_ * std::log1p(expected / shape_);
      if (run.events > 0) sum += run.events * std::log(expected / (shape_ + expected));
    }
    return sum;
  }

 private:
  const Counts& runs_;
  double shape_, of_counts_ = 0;
};

// Universal inference (Wasserman, Ramdas & Balakrishnan 2020): the mean likelihood of an alternative with
// some variations, divided by the greatest that `share` has with any. So steady runs count for more, and the
// spread is never an estimate.
class Against {
 public:
  Against(const Counts& runs, double share, double most_variation) {
    constexpr int shapes = 10;
    auto shape = 1 / most_variation;
    for (int i = 0; i < shapes; ++i, shape *= 2) {
      likelihoods_.emplace_back(runs, shape);
      greatest_ = std::max(greatest_, likelihoods_.back().of(share));
    }
  }

  double operator()(double alternative) const {
    if (!std::isfinite(greatest_)) return 1;  // neither share is possible
    // A few runs do not show how much they vary: half of the weight is on the most.
    constexpr std::pair<std::size_t, double> weights[] = {
        {0, 1.0 / 2}, {2, 1.0 / 6}, {4, 1.0 / 6}, {6, 1.0 / 6}};
    double sum = 0;
    for (const auto& [shape, weight] : weights)
      sum += weight * std::exp(likelihoods_[shape].of(alternative) - greatest_);
    return sum;
  }

 private:
  std::vector<LogLikelihood> likelihoods_;
  double greatest_ = -std::numeric_limits<double>::infinity();
};

// Half of the weight is on a share of 0, which a search wants to prove.
template <class LikelihoodRatio>
double mean_of_lower(double share, LikelihoodRatio ratio) {
  constexpr double parts[] = {1.0 / 16, 1.0 / 8, 1.0 / 4, 1.0 / 2};
  double sum = 0;
  for (const double part : parts) sum += ratio(part * share);
  return (ratio(0.0) + sum / std::size(parts)) / 2;
}

template <class LikelihoodRatio>
double mean_of_higher(double share, LikelihoodRatio ratio) {
  // Odds and not shares are multiplied, so that each alternative is one.
  constexpr double factors[] = {2, 4, 16, 64, 256};
  double sum = 0;
  for (const double factor : factors) sum += ratio(factor * share / (1 - share + factor * share));
  return sum / std::size(factors);
}

// The border of the shares that the evidence excludes, between one that it does not and one that it does.
template <class Excludes>
double border(double kept, double excluded, Excludes excludes) {
  constexpr int halvings = 60;
  for (int i = 0; i < halvings; ++i) {
    const auto middle = (kept + excluded) / 2;
    (excludes(middle) ? excluded : kept) = middle;
  }
  return kept;
}

}  // namespace

double against_at_least(const Count& count, double share) {
  return mean_of_lower(share, [&](double lower) { return likelihood_ratio(count, share, lower); });
}

double against_at_most(const Count& count, double share) {
  return mean_of_higher(share, [&](double higher) { return likelihood_ratio(count, share, higher); });
}

double against_at_least(const Counts& runs, double share, double most_variation) {
  return mean_of_lower(share, Against(runs, share, most_variation));
}

double against_at_most(const Counts& runs, double share, double most_variation) {
  return mean_of_higher(share, Against(runs, share, most_variation));
}

double less_than(const Count& first, const Count& second) {
  const auto messages = first.messages + second.messages;
  if (first.messages <= 0 || second.messages <= 0) return 1;
  return against_at_least({first.events, first.events + second.events}, first.messages / messages);
}

Range range_of(const Count& count, double alpha) {
  if (count.messages <= 0) return {};
  const auto seen = count.events / count.messages;
  const auto needed = 2 / alpha;
  Range range;
  if (seen > 0)
    range.low = border(seen, 0, [&](double s) { return s <= 0 || against_at_most(count, s) >= needed; });
  if (seen < 1)
    range.high = border(seen, 1, [&](double s) { return s >= 1 || against_at_least(count, s) >= needed; });
  return range;
}

double upper_limit(const Counts& runs, double most_variation, double alpha, double asked) {
  Count all;
  for (const auto& run : runs) all = {all.events + run.events, all.messages + run.messages};
  if (all.messages <= 0) return 1;
  const auto is_not_excluded = [&](double share) {
    return against_at_least(runs, share, most_variation) < 1 / alpha;
  };
  // The evidence does not rise with the share everywhere: a greater one may be excluded less.
  return border(is_not_excluded(asked) ? 1 : asked, all.events / all.messages, is_not_excluded);
}

}  // namespace ontime::search

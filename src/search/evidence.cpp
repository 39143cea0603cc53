// SPDX-License-Identifier: Apache-2.0
#include "search/evidence.hpp"

#include <cmath>

namespace ontime::search {
namespace {

// Without events an alternative of 0 has a likelihood; with events it has none.
double term(double count, double factor) { return count > 0 ? count * std::log(factor) : 0; }

double likelihood_ratio(const Count& count, double share, double alternative) {
  return std::exp(term(count.events, alternative / share) +
                  term(count.messages - count.events, (1 - alternative) / (1 - share)));
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
  // Half of the weight is on a share of 0, which a search wants to prove.
  constexpr double parts[] = {1.0 / 16, 1.0 / 8, 1.0 / 4, 1.0 / 2};
  double sum = 0;
  for (const double part : parts) sum += likelihood_ratio(count, share, part * share);
  return (likelihood_ratio(count, share, 0) + sum / std::size(parts)) / 2;
}

double against_at_most(const Count& count, double share) {
  // Odds and not shares are multiplied, so that each alternative is one.
  constexpr double factors[] = {2, 4, 16, 64, 256};
  double sum = 0;
  for (const double factor : factors)
    sum += likelihood_ratio(count, share, factor * share / (1 - share + factor * share));
  return sum / std::size(factors);
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

double upper_limit(const Count& count, double alpha) {
  if (count.messages <= 0) return 1;
  return border(1, count.events / count.messages,
                [&](double share) { return against_at_least(count, share) < 1 / alpha; });
}

}  // namespace ontime::search

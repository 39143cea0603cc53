// SPDX-License-Identifier: Apache-2.0
#include "statistics/confidence.hpp"

#include <algorithm>
#include <cmath>

#include <boost/math/distributions/students_t.hpp>
#include <boost/math/special_functions/beta.hpp>

namespace ontime::statistics {
namespace {

constexpr double fewest_events = 10;    // to tell how they depend on one another
constexpr double fewest_effective = 3;  // not all of one burst
constexpr std::size_t fewest_batches = 8;
constexpr std::size_t most_of_memory = 32;
constexpr double most_effective = 1e9;  // more make no interval visibly narrower
constexpr double normal_97_5 = 1.959963984540054;

// Of the share of events, out of the variance between the batches (linearised, for they need not be equally
// long: Cochran 1977, ch. 6).
double variance(std::span<const Batch> batches, const Batch& all) {
  const double share = all.events / all.values;
  double squares = 0;
  for (const auto& [values, events] : batches) squares += std::pow(events - share * values, 2);
  const auto n = static_cast<double>(batches.size());
  return squares * n / (n - 1) / (all.values * all.values);
}

std::vector<Batch> pairs_of(std::span<const Batch> batches) {
  std::vector<Batch> pairs;
  for (std::size_t i = 0; i < batches.size(); i += 2)
    pairs.push_back(sum_of(batches.subspan(i, std::min<std::size_t>(2, batches.size() - i))));
  return pairs;
}

double students_t(double degrees, double one_sided) {
  return boost::math::quantile(boost::math::students_t(degrees), one_sided);
}

Interval clopper_pearson(double events, double messages, double confidence) {
  const double tail = (1 - confidence) / 2;
  Interval interval{0.0, 1.0};
  if (events > 0) interval.low = boost::math::ibeta_inv(events, messages - events + 1, tail);
  if (events < messages) interval.high = boost::math::ibeta_inv(events + 1, messages - events, 1 - tail);
  return interval;
}

void set_limits(Probability& of, double messages, double fewer) {
  const auto limits = [&](double confidence) {
    auto lies = clopper_pearson(of.value * messages, messages, confidence);
    // An event is no better news than none, nor is a message without it than that all had it.
    lies.high = std::max(lies.high, clopper_pearson(0, fewer, confidence).high);
    lies.low = std::min(lies.low, clopper_pearson(fewer, fewer, confidence).low);
    return lies;
  };
  of.sure = limits(0.95);
  of.surer = limits(0.98);
  of.bound = limits(0.90).high.value_or(1);
}

}  // namespace

Batch sum_of(std::span<const Batch> batches) {
  Batch sum;
  for (const auto& [values, events] : batches) {
    sum.values += values;
    sum.events += events;
  }
  return sum;
}

void Batches::add(const Batch& some) {
  open_.values += some.values;
  open_.events += some.events;
  if (open_.values < length_) return;
  full_.push_back(open_);
  open_ = {};
  if (full_.size() < most_batches) return;
  full_ = pairs_of(full_);
  length_ *= 2;
}

std::vector<Batch> Batches::all() const {
  auto batches = full_;
  if (open_.values > 0) batches.push_back(open_);
  return batches;
}

double design_effect(std::span<const Batch> given) {
  std::vector<Batch> batches(given.begin(), given.end());
  const auto all = sum_of(batches);
  const double share = all.values > 0 ? all.events / all.values : 0;
  double greatest = 1;
  if (share <= 0 || share >= 1) return greatest;
  for (; batches.size() >= fewest_batches; batches = pairs_of(batches)) {
    const double independent = share * (1 - share) / all.values;
    const double of_few = students_t(static_cast<double>(batches.size() - 1), 0.975) / normal_97_5;
    greatest = std::max(greatest, variance(batches, all) / independent * of_few * of_few);
  }
  return greatest;
}

double memory(std::span<const Batch> given) {
  std::vector<Batch> batches(given.begin(), given.end());
  while (batches.size() > most_of_memory) batches = pairs_of(batches);
  if (batches.size() < fewest_batches) return 0;
  const auto all = sum_of(batches);
  const double share = all.events / all.values;
  double squares = 0, products = 0, last = 0;
  for (const auto& [values, events] : batches) {
    const double deviation = events - share * values;
    squares += deviation * deviation;
    products += deviation * last;
    last = deviation;
  }
  return squares > 0 ? products / squares * std::sqrt(static_cast<double>(batches.size())) : 0;
}

double tail_effect(std::span<const Batch> batches, double effect_before) {
  const auto effect = design_effect(batches);
  return sum_of(batches).events / effect < fewest_events ? std::max(effect, effect_before) : effect;
}

double slowest_effect(std::span<const std::vector<Batch>> rarest_first) {
  double effect = 1;
  for (const auto& batches : rarest_first) {
    const auto own_effect = design_effect(batches);
    effect = std::max(effect, own_effect);
    const auto events = sum_of(batches).events;
    if (events >= fewest_events && events / own_effect >= fewest_effective) break;
  }
  return effect;
}

Measured mean(std::span<const Batch> given, double value) {
  Measured result;
  result.value = value;
  std::vector<Batch> batches(given.begin(), given.end());
  const auto all = sum_of(batches);
  for (const auto& [confidence, interval] : {std::pair{0.95, &result.sure}, {0.98, &result.surer}}) {
    double half_width = 0;
    for (auto some = batches; some.size() >= fewest_batches; some = pairs_of(some))
      half_width =
          std::max(half_width, students_t(static_cast<double>(some.size() - 1), (1 + confidence) / 2) *
                                   std::sqrt(variance(some, all)));
    if (batches.size() >= fewest_batches) *interval = {value - half_width, value + half_width};
  }
  if (!result.sure.low) result.open = "too few messages";
  return result;
}

Shares quantile_shares(double share, double effective, double confidence) {
  effective = std::min(effective, most_effective);
  const double tail = (1 - confidence) / 2;
  // How probable it is that the value of this rank, out of `effective` ones, is below the quantile: less, the
  // higher the rank.
  const auto below = [&](std::uint64_t rank) {
    const auto k = static_cast<double>(rank);
    return boost::math::ibeta(k, effective - k + 1, share);
  };
  const auto greatest = static_cast<std::uint64_t>(effective);
  const auto last_with = [&](double probability) {  // 0: none
    std::uint64_t low = 0, high = greatest;
    while (low < high) {
      const auto middle = low + (high - low + 1) / 2;
      if (below(middle) >= probability)
        low = middle;
      else
        high = middle - 1;
    }
    return low;
  };
  Shares shares;
  if (const auto rank = last_with(1 - tail); rank > 0) shares.low = static_cast<double>(rank) / effective;
  if (const auto rank = last_with(tail) + 1; rank <= greatest)
    shares.high = static_cast<double>(rank) / effective;
  return shares;
}

Probability probability(std::uint64_t events, std::uint64_t messages, double own_effect,
                        double effect_of_few) {
  Probability result;
  result.events = events;
  result.messages = messages;
  if (messages == 0) return result;
  const auto all = static_cast<double>(messages);
  result.value = static_cast<double>(events) / all;
  const double greater_effect = std::max(own_effect, effect_of_few);
  const auto rarer = static_cast<double>(std::min(events, messages - events));
  result.effect = rarer / own_effect < fewest_events ? greater_effect : own_effect;
  const auto effective = [&](double effect) { return std::clamp(all / effect, 1.0, most_effective); };
  set_limits(result, effective(own_effect), effective(greater_effect));
  return result;
}

Probability probability(std::span<const Batch> batches, double effect_of_few) {
  const auto all = sum_of(batches);
  return probability(static_cast<std::uint64_t>(all.events), static_cast<std::uint64_t>(all.values),
                     design_effect(batches), effect_of_few);
}

Probability pooled(std::span<const Probability> runs) {
  Probability result;
  double effective = 0;
  for (const auto& run : runs) {
    result.events += run.events;
    result.messages += run.messages;
    effective += static_cast<double>(run.messages) / run.effect;
  }
  if (result.messages == 0) return result;
  const auto messages = static_cast<double>(result.messages);
  result.value = static_cast<double>(result.events) / messages;
  effective = std::clamp(effective, 1.0, most_effective);
  result.effect = messages / effective;
  set_limits(result, effective, effective);
  return result;
}

double messages_to_claim(double probability, double effect) {
  return std::ceil(std::log(0.05) / std::log1p(-probability) * effect);
}

}  // namespace ontime::statistics

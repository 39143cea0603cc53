// SPDX-License-Identifier: Apache-2.0
#include "search/measured.hpp"

#include <algorithm>
#include <cmath>

namespace ontime::search {
namespace {

constexpr double no_less_than = 0.7;  // of the reference's share: a set above it is given up
// Relative variance between runs that is assumed before there are many.
constexpr double prior_variation = 0.05, prior_freedoms = 2;

Count sum(const Runs& runs, std::size_t limit) {
  Count sum;
  for (const auto* run : runs) {
    sum.events += run->tallies[limit].events;
    sum.messages += run->tallies[limit].messages;
  }
  return sum;
}

double effect_of(const Runs& runs, std::size_t limit) {
  double weighted = 0, messages = 0;
  for (const auto* run : runs) {
    weighted += run->tallies[limit].effect * run->tallies[limit].messages;
    messages += run->tallies[limit].messages;
  }
  return messages > 0 ? std::max(1.0, weighted / messages) : 1;
}

double per_run(const Runs& runs, const Runs& others = {}) {
  return std::max(1.0, static_cast<double>(runs.size() + others.size()));
}

}  // namespace

double most_variation(const Limit& limit) { return limit.share > 0 ? 0.5 : 0.1; }

template <class Holds>
bool Measured::all_limits(Holds holds) const {
  for (std::size_t limit = 0; limit < limits(); ++limit)
    if (!holds(limit)) return false;
  return true;
}

// The mean of e-values is an e-value, however they depend on one another.
template <class Of>
double Measured::mean(Of of) const {
  double sum = 0;
  for (std::size_t limit = 0; limit < limits(); ++limit) sum += of(limit);
  return sum / static_cast<double>(limits());
}

const Answer* Measured::add(const Set& set, Answer run) {
  for (const auto& tally : run.tallies) per_run_ = std::max(per_run_, tally.messages);
  return runs_[set].emplace_back(std::make_unique<Answer>(std::move(run))).get();
}

Runs Measured::of(const Set& set) const {
  Runs runs;
  if (const auto found = runs_.find(set); found != runs_.end())
    for (const auto& run : found->second) runs.push_back(run.get());
  return runs;
}

std::vector<Share> Measured::shares(const Runs& runs, double alpha) const {
  std::vector<Share> shares;
  for (std::size_t limit = 0; limit < limits(); ++limit) {
    const auto seen = sum(runs, limit);
    const auto range = range_of(effective(seen, spread(limit, runs), seen.events / per_run(runs)), alpha);
    shares.push_back({range, seen.events, seen.messages});
  }
  return shares;
}

bool Measured::holds(const Runs& runs, double alpha) const {
  return !runs.empty() && all_limits([&](std::size_t limit) {
    return against_at_least(independent(runs, limit), permitted(runs, limit),
                            most_variation(problem_.goal[limit])) >= 1 / alpha;
  });
}

bool Measured::fails(const Runs& runs, double alpha) const {
  return mean([&](std::size_t limit) {
           return against_at_most(independent(runs, limit), permitted(runs, limit),
                                  most_variation(problem_.goal[limit]));
         }) >= 1 / alpha;
}

bool Measured::fewer(const Runs& one, const Runs& other, double alpha) const {
  return mean([&](std::size_t limit) {
           const auto mine = sum(one, limit), theirs = sum(other, limit);
           const auto of_a_run = (mine.events + theirs.events) / per_run(one, other);
           return less_than(effective(mine, spread(limit, one), of_a_run),
                            effective(theirs, spread(limit, other), of_a_run));
         }) >= 1 / alpha;
}

bool Measured::kept_to(const Runs& runs) const {
  return all_limits([&](std::size_t limit) {
    const auto [events, messages] = sum(runs, limit);
    return events <= problem_.goal[limit].share * messages;
  });
}

std::vector<Proof> Measured::proofs(const Runs& runs, double alpha) const {
  std::vector<Proof> proofs;
  for (std::size_t limit = 0; limit < limits(); ++limit)
    proofs.push_back({upper_limit(independent(runs, limit), most_variation(problem_.goal[limit]), alpha,
                                  permitted(runs, limit)),
                      permitted(runs, limit), spread(limit, runs).within});
  return proofs;
}

bool Measured::looks_no_less(const Runs& one, const Runs& other) const {
  return all_limits([&](std::size_t limit) {
    const auto mine = sum(one, limit), theirs = sum(other, limit);
    return mine.events >= no_less_than * theirs.events * mine.messages / theirs.messages;
  });
}

double Measured::permitted(const Runs& runs, std::size_t limit) const {
  const auto share = problem_.goal[limit].share;
  const auto burst = spread(limit, runs).within;
  return share > 0 ? share : burst / std::max(per_run_, 2 * burst);
}

Counts Measured::independent(const Runs& runs, std::size_t limit) const {
  const auto burst = spread(limit, runs).within;
  Counts counts;
  for (const auto* run : runs)
    counts.push_back({run->tallies[limit].events / burst, run->tallies[limit].messages / burst});
  return counts;
}

// Divided by the design effect if `of_a_run` messages of each run break the limit.
Count Measured::effective(const Count& count, const Spread& spread, double of_a_run) {
  const auto effect = spread.within + spread.between * of_a_run;
  return {count.events / effect, count.messages / effect};
}

Measured::Spread Measured::spread(std::size_t limit, const Runs& own) const {
  double variation = prior_variation * prior_freedoms, freedoms = prior_freedoms;
  Runs all;
  for (const auto& [set, unused] : runs_) {
    const auto runs = of(set);
    all.insert(all.end(), runs.begin(), runs.end());
    const auto count = static_cast<double>(runs.size()), within = effect_of(runs, limit);
    double events = 0, squares = 0;
    for (const auto* run : runs) events += run->tallies[limit].events / count;
    if (runs.size() < 2 || events < 2 * within) continue;
    for (const auto* run : runs) squares += std::pow(run->tallies[limit].events / events - 1, 2);
    variation += squares - (count - 1) * within / events;
    freedoms += count - 1;
  }
  // Calm runs show no bursts: they must not shorten those of others.
  return {std::max(effect_of(all, limit), effect_of(own, limit)), std::max(0.0, variation / freedoms)};
}

}  // namespace ontime::search

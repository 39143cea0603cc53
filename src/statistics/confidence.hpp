// SPDX-License-Identifier: Apache-2.0
// Confidence of a run's metrics, though its messages depend on one another: latency comes in bursts, and a
// thousand messages of one burst tell less than a thousand on their own. All of it is about the process that
// the run is a piece of, as long as that goes on as it did. Ordinary thread.
//
// A share of messages (those above a threshold, late or lost ones): the run is cut into batches one after
// another; what their counts vary more than those of independent messages would is the design effect, by
// which there are fewer effective messages (batch means: Alexopoulos & Seila 1998; as survey statistics do
// with clusters: Korn & Graubard 1998, whose degrees of freedom are used as well). Batches of several lengths
// are tried, and the greatest effect counts: one that is too short misses part of it. With these effective
// messages follow the exact limits of Clopper & Pearson 1934.
// A percentile: the order statistics between which it lies (Woodruff 1952; exact binomial test turned round),
// of as many messages as are effective at its threshold.
// A mean: the means of the batches, with Student's t; and above, what causes that the run did not see may
// add.
//
// An end that the run does not support is missing, and Measured::open says why: few slower messages, few
// bursts, or a run that is short for its own memory. A median that changes for good is found (cumulative
// sums), and the intervals then hold for the level before and after.
//
// Not valid when tomorrow is not as today: a mode or a cause that the run never saw is in no interval.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "statistics/metric.hpp"

namespace ontime::statistics {

// Nothing: not bounded on this side by what was measured.
struct Interval {
  std::optional<double> low, high;
};

struct Measured {
  double value = 0;
  Interval sure;          // holds the true one with 95 % confidence
  Interval surer;         // with 98 %, so that either end alone is passed once in a hundred: for comparisons
  double effect = 1;      // the design effect: so many messages tell as much as an independent one
  const char* open = "";  // why an end is missing, for people
};

// A share of messages: late ones, lost ones.
struct Probability : Measured {
  std::uint64_t events = 0, messages = 0;
  // One-sided, with 95 % confidence. After no event it bounds incidents: one may be several messages in a
  // row, and a run that saw none does not tell how many.
  double bound = 1;
};

// The median changed for good after this share of the values: it is a mixture of two levels. The intervals
// then hold for either.
struct Shift {
  double share = 0, before_ns = 0, after_ns = 0;
  std::optional<double> from_ns = {};  // of round trips: after the run began, the first of the new level
};

// Of a distribution, in ns. Nothing: no value.
struct Certainty {
  Measured mean;
  std::array<Measured, percentiles.size()> quantiles;
  // Of a percentile, or the mean.
  Measured& operator[](Figure figure) {
    return figure == Figure::mean ? mean : quantiles.at(place_of(figure));
  }
  const Measured& operator[](Figure figure) const {
    return figure == Figure::mean ? mean : quantiles.at(place_of(figure));
  }
  std::optional<Shift> shift;
  double slowest_effect = 1;  // of the slowest: what is handed to misses, of which there are few or none
};

// Late or lost messages one right after another: what stops an arm.
struct Bursts {
  std::uint64_t count = 0;      // of two or more in a row
  std::uint64_t longest = 0;    // in messages; 1: there were some, but never two in a row
  std::int64_t longest_ns = 0;  // from when its first message was due until its last was answered or given up
};

// A stretch of a run: how many values, and of these how many are what is asked for.
struct Batch {
  double values = 0, events = 0;
};
Batch sum_of(std::span<const Batch>);

// Batches one after another of as many messages each, as they go by: no more than most_batches, which become
// longer.
inline constexpr std::size_t most_batches = 128;
class Batches {
 public:
  void add(bool event) { add(Batch{1, event ? 1.0 : 0.0}); }
  void add(const Batch&);  // of messages that are not told apart
  std::vector<Batch> all() const;

 private:
  std::vector<Batch> full_;
  Batch open_;
  double length_ = 1;
};

// The greatest design effect of a share over batches of several lengths, times what Student's t has more than
// the normal distribution at 97.5 % for as few batches; 1 at least.
double design_effect(std::span<const Batch>);

// How much neighbouring thirty-seconds of the run resemble each other: their lag-1 autocorrelation in
// standard errors. Where they do, the run is too short to tell how its messages depend on one another.
double memory(std::span<const Batch>);

// The same of a share far out: where it is fewer than ten effective messages, they do not tell their
// dependence either, and that of the threshold before it, which ten times as many pass, counts as well.
double tail_effect(std::span<const Batch>, double effect_before);

// Of what is rarer than all of these, which are given the rarest first: the greatest up to the first one that
// tells it, by three effective messages of ten at least. One that does not may come from a single stall: no
// proof that stalls are all that long, but none that they are shorter. What most messages do is not asked:
// the median of a run drifts without anything in its tail.
double slowest_effect(std::span<const std::vector<Batch>> rarest_first);

// Between which shares of the sorted values the quantile lies. Nothing: beyond all of them.
struct Shares {
  std::optional<double> low, high;
};
Shares quantile_shares(double share, double effective, double confidence);

// Of batches that have their values' sum for events.
Measured mean(std::span<const Batch>, double value);

// `effect_of_few`: taken where there were too few events, or messages without, to tell how they depend on one
// another. One event does not make the limits tighter than none would: those are never passed.
Probability probability(std::span<const Batch>, double effect_of_few);
Probability probability(std::uint64_t events, std::uint64_t messages, double own_effect,
                        double effect_of_few);

// Of repetitions: all of their messages together, each by its own run's design effect.
Probability pooled(std::span<const Probability>);

// Messages without any event that allow the claim that its probability is below `probability`, with 95 %
// confidence.
double messages_to_claim(double probability, double effect);

}  // namespace ontime::statistics

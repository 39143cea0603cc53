// SPDX-License-Identifier: Apache-2.0
// Confidence intervals of a run's metrics. Messages depend on one another: latency comes in bursts, and a
// thousand messages of one burst contain less information than a thousand independent ones. The intervals
// hold for the process that the run samples, as long as that process does not change. Ordinary thread.
//
// A share of messages (those above a threshold, late or lost ones): the run is cut into consecutive batches.
// Their counts vary more than those of independent messages would. This factor is the design effect; it
// divides the number of messages to give the effective sample size (batch means: Alexopoulos & Seila 1998;
// clusters in surveys, with their degrees of freedom: Korn & Graubard 1998). Batches of several lengths are
// tried and the greatest effect counts, because short batches miss part of it. The effective sample size
// gives the exact limits of Clopper & Pearson 1934. A percentile: two order statistics enclose it (Woodruff
// 1952; inverted exact binomial test), with the effective sample size at its threshold. A mean: the means of
// the batches, with Student's t. Its upper limit adds what causes that the run did not see may add.
//
// A limit that the data do not support is missing, and Measured::open says why: few slower messages, few
// bursts, or a run that is too short for how long its messages depend on one another. A median that changes
// for good is found (cumulative sums), and the intervals then hold for the level before and after.
//
// Not valid when conditions change: no interval covers a mode or a cause that the run never saw.
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
  Interval sure;      // the 95 % confidence interval
  Interval surer;     // the 98 % interval: the truth passes each limit alone in 1 % of cases; for comparisons
  double effect = 1;  // the design effect: messages per effective (independent) message
  const char* open = "";  // why a limit is missing, for people
};

// A share of messages: late ones, lost ones.
struct Probability : Measured {
  std::uint64_t events = 0, messages = 0;
  // One-sided, with 95 % confidence. Without events it bounds incidents. An incident may be several messages
  // in a row; a run without events does not show how many.
  double bound = 1;
};

// The median changed permanently after this share of the values: the run is a mixture of two levels. The
// intervals then hold for both.
struct Shift {
  double share = 0, before_ns = 0, after_ns = 0;
  std::optional<double> from_ns = {};  // of round trips: start of the new level, since the run began
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
  double slowest_effect = 1;  // of the slowest messages: used for misses, which are rare
};

// Consecutive late or lost messages: these stop a robot's arm.
struct Bursts {
  std::uint64_t count = 0;    // of two or more in a row
  std::uint64_t longest = 0;  // in messages; 1: there were some, but never two in a row
  // From when its first message was due until its last was due: a time-out would hide how long a link was
  // cut.
  std::int64_t longest_ns = 0;
};

// A part of a run: its number of values, and how many of these count as events.
struct Batch {
  double values = 0, events = 0;
};
Batch sum_of(std::span<const Batch>);

// Cuts a stream of messages into consecutive batches of equal length. At most_batches, pairs are merged into
// longer batches.
inline constexpr std::size_t most_batches = 128;
class Batches {
 public:
  void add(bool event) { add(Batch{1, event ? 1.0 : 0.0}); }
  void add(const Batch&);  // of messages that are only counted together
  std::vector<Batch> all() const;

 private:
  std::vector<Batch> full_;
  Batch open_;
  double length_ = 1;
};

// The greatest design effect of a share over batches of several lengths, times the ratio of Student's t to
// the normal distribution at 97.5 % for this number of batches; at least 1.
double design_effect(std::span<const Batch>);

// How much adjacent 1/32 parts of the run resemble each other: their lag-1 autocorrelation in standard
// errors. If it is high, the run is too short to show how its messages depend on one another.
double memory(std::span<const Batch>);

// The design effect of a share far out in the tail. Fewer than ten effective messages do not show their
// dependence. Then the effect of the threshold before it, which ten times as many pass, counts as well.
double tail_effect(std::span<const Batch>, double effect_before);

// The design effect for events that are rarer than all of these. It is the greatest effect, from the rarest
// up to the first with enough evidence: at least three effective messages of ten. A rarer one may come from a
// single stall, which proves neither that all stalls are that long nor that they are shorter. More frequent
// events do not count: a run's median can drift without any effect in its tail.
double slowest_effect(std::span<const std::vector<Batch>> rarest_first);

// The shares of the sorted values that enclose the quantile. Nothing: it is beyond all values.
struct Shares {
  std::optional<double> low, high;
};
Shares quantile_shares(double share, double effective, double confidence);

// Of batches with the sum of their values as `events`.
Measured mean(std::span<const Batch>, double value);

// `effect_of_few` is used if there were too few events, or too few messages without one, to show how they
// depend on one another. One event never gives tighter limits than no event would.
Probability probability(std::span<const Batch>, double effect_of_few);
Probability probability(std::uint64_t events, std::uint64_t messages, double own_effect,
                        double effect_of_few);

// Of repetitions: all their messages together, each with the design effect of its run.
Probability pooled(std::span<const Probability>);

// Messages without any event that allow the claim that its probability is below `probability`, with 95 %
// confidence.
double messages_to_claim(double probability, double effect);

}  // namespace ontime::statistics

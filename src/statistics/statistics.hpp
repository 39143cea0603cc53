// SPDX-License-Identifier: Apache-2.0
// Numbers from samples, in one pass over them. Exact: every counted sample is in, late ones too; lost ones
// have no round trip and are counted by themselves. Ordinary thread.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "record/record.hpp"
#include "statistics/confidence.hpp"
#include "statistics/extremes.hpp"
#include "statistics/metric.hpp"

namespace ontime::statistics {

// Percentiles by nearest rank: the smallest value that at least p % of the values do not exceed
// (Hyndman & Fan 1996, definition 1). Nanoseconds.
struct Distribution {
  std::uint64_t count = 0;
  std::int64_t min = 0, max = 0;
  double mean = 0;
  std::array<std::int64_t, percentiles.size()> quantiles{};
  // Of a percentile, or the maximum.
  std::int64_t& operator[](Figure figure) {
    return figure == Figure::max ? max : quantiles.at(place_of(figure));
  }
  std::int64_t operator[](Figure figure) const {
    return figure == Figure::max ? max : quantiles.at(place_of(figure));
  }
};
Distribution distribution(const std::vector<std::int64_t>& values);  // all zero for no values

// How values are distributed: bins from_ns <= value < to_ns, 16 to every doubling, all of the same ratio
// (rounded to whole nanoseconds), in order, without empty ones.
struct Bin {
  std::int64_t from_ns, to_ns;
  std::uint64_t count;
};
using Histogram = std::vector<Bin>;

// Some of the sorted values, with their ranks from 1: the highest 128, of the others 32 for each doubling of
// how many are higher, and the lowest.
struct Ranked {
  std::uint64_t rank;
  std::int64_t value;
};

// A stretch of a run, by when messages were due. Times of round trips are 0 where nothing was answered.
struct Slice {
  std::uint64_t sent = 0, late = 0, lost = 0, skipped_cycles = 0;
  std::int64_t min_ns = 0, p50_ns = 0, max_ns = 0;  // of round trips
  std::int64_t skipped_wait_max_ns = 0;             // of the skipped cycles due here: until an answer came
};

// One of the longest waits that a message caused, with the messages before and after it.
struct Worst {
  // Until its answer came, from when the first cycle that waited for it was due, or, where that waited for
  // the message before it, from when that one was over.
  std::int64_t took_ns = 0;
  std::optional<roundtrip::Sample> before;
  roundtrip::Sample message{};
  std::optional<roundtrip::Sample> after;
};

// Data for figures. Bounded for any length of run; keeps every extreme.
struct Shape {
  Histogram round_trip, response;
  std::vector<Ranked> round_trip_ranks, response_ranks;
  std::int64_t slice_ns = 0;  // length of a slice; longer if the run exceeds its stated duration
  std::vector<Slice> slices;  // from the first message on; at most 2,000
  // At most 20 messages, due more than ten times as late as all others. They are in no slice.
  std::vector<roundtrip::Sample> beyond;
  std::vector<Worst> worst;  // at most 10, the longest first; lost messages are not among them
};

// Request leg and reply leg of a round trip, if both ends share one clock or have synchronised clocks.
// Between them is Summary::server.
struct Parts {
  Distribution there;         // sent → received by the server
  Distribution back;          // sent by the server → received
  std::int64_t error_ns = 0;  // by how much each may be off; of one clock 0
  bool one_clock = true;
};

// A histogram of another tool: counts of values without their times. Such a run has no samples and no
// messages, only `wake_up`, and nothing that needs an order in time.
struct Imported {
  std::string from, file;          // docs/reference/json.md, `imported`
  std::int64_t resolution_ns = 0;  // values were rounded down to multiples of it
  // So many of the values are only known to be of `beyond_from_ns` or more; the greatest is known.
  // Percentiles among them are given as `beyond_from_ns`, which is where they begin.
  std::uint64_t beyond = 0;
  std::int64_t beyond_from_ns = 0;
};

// Of one run. sent = on_time + late + lost.
struct Summary {
  record::Run run;
  std::vector<record::Note> notes;
  std::int64_t start_ns = 0;  // when its first message was due: the client's clock, as that of notes
  std::uint64_t sent = 0, on_time = 0, late = 0, lost = 0;
  std::uint64_t skipped_cycles = 0;  // including those after the last message
  // Number of messages at the end without an answer, and when the first of these was due.
  std::uint64_t unanswered_at_end = 0;
  std::int64_t unanswered_from_ns = 0;
  // Cycles without an answer within the deadline from when they were due, where the record has a deadline:
  // responses above it, and lost messages. Of sent + skipped_cycles.
  std::optional<std::uint64_t> late_by_response;
  Distribution round_trip;  // sent → received: the paper's T2 − T1
  // Due → answered, of every cycle, also of skipped ones: until the answer that ended their wait, or, without
  // such an answer, as long as they are known to have waited. Hides no stall. A lost message has no response
  // time.
  Distribution response;
  // The longest wait that no answer ended, or none whose sample is there; 0: no such wait, or no cycles.
  std::int64_t open_wait_ns = 0;
  // The longest of a cycle whose message was lost that the answer to a later one ended; 0: no such wait.
  std::int64_t lost_wait_ns = 0;
  // Sender wake-up latency: due → woke; none in back-to-back. Of the wake-ups for the cycles skipped before a
  // message only the longest counts.
  Distribution wake_up;
  Distribution server;         // received → sent, on the server's clock; count 0 if unknown
  std::optional<Parts> parts;  // nothing, unless the record shows that the clocks allow it
  std::string no_parts;        // why they are missing, for users
  std::optional<Imported> imported;
  // Its samples are only those around the worst messages; all counts, and the distributions to within 1.6 %,
  // are of all messages.
  bool has_worst_only = false;
  Shape shape;

  // Intervals: confidence.hpp. If samples are missing, these have no intervals, no messages and no bound.
  Certainty round_trip_certainty, response_certainty;
  // That a message is late, is lost, or either.
  Probability late_probability, lost_probability, missed_probability;
  Probability late_by_response_probability;  // of a cycle; no messages where late_by_response is nothing
  Bursts bursts;
  Extremes extremes;            // of the round trips: extremes.hpp
  double message_every_ns = 0;  // on average; 0 of fewer than two
};
Summary summarise(const record::Reader&, const record::Run&);
// "the median rises from 150 µs to 300 µs at 100 s". Empty: no permanent change.
std::string shift_text(const Summary&);
std::string time_of(double ns, int digits = 4);  // "28.25 ms"
// Of all runs but the first `known`.
std::vector<Summary> summarise(const record::Reader&, std::size_t known = 0);

// For listened messages some counts are unknown: without a limit no message counts as late, and not every
// source shows losses. An unknown count has a probability with 0 messages.
inline bool knows_late(const record::Run& run) {
  return !run.asked.is_listened() || run.asked.task.client.deadline.count() > 0;
}
inline bool knows_loss(const record::Run& run) {
  // No period tells it. Without an outcome, as while a run goes on, the record does not say so.
  return !run.outcome.loss_unknown && !(run.asked.is_listened() && run.asked.measures == "period");
}

// Messages, cycles without one, and cycles without an answer in time. Where samples are missing: at least
// what the client counted.
struct Fates {
  std::uint64_t sent, late, lost, skipped, not_in_time;
};
Fates fates_of(const Summary&);

// Whether a percentile of an imported run is among the values of which only `beyond_from_ns` is known.
inline bool is_lower_bound(const Summary& run, Figure figure) {
  if (!run.imported || figure == Figure::max) return false;
  const auto rank = metric_of(figure).rank_of(run.wake_up.count);
  return rank > run.wake_up.count - run.imported->beyond && rank < run.wake_up.count;
}

// Measured to its end: not cut off, interrupted or failed.
inline bool is_complete(const record::Run& run) {
  return run.outcome.document.is_object() && run.outcome.has_ended() && !run.outcome.error &&
         !run.outcome.interrupted;
}
// The number of messages whose samples were not recorded. If it is not 0, no metric is of all messages, and
// no bound holds.
inline std::uint64_t unrecorded(const record::Run& run) { return run.outcome.counters.dropped_records; }

// In ns. For late and lost: the share of all messages; for late response times: the share of all cycles.
// `max` is the greatest value seen and has no interval.
std::optional<Measured> measured(const Summary&, Times, Figure);  // nothing: no message was answered, or sent
// Of late and lost messages; nothing of times.
const Probability* probability_of(const Summary&, Times, Figure);

// If not all ranks are kept, a count of messages is known only within two limits; else both are the same.
struct Between {
  Probability at_least, at_most;
  std::uint64_t unanswered = 0;  // among the messages
};
// How many messages, or cycles, take longer than the limit: exact among the slowest 128 answers, else to
// within 2.2 %. One without an answer took at least its time-out; what a robot's topic lost has none and is
// left out. The design effect is the greater of those of the adjacent percentiles; with very few, that of the
// slowest; where answers are missing, at least theirs.
Between slower_than(const Summary&, Times, double limit_ns);

// Compares one or several runs with one or several others, by their means. For the maximum: the greatest of
// all runs, without intervals, and without a ratio where one side has over a tenth more values: the more
// values, the greater their maximum. A percentile is unknown if a run has too few values for it.
//
// The truth is beyond each limit of an interval in at most 1 % of cases. Two intervals are computed, and
// the wider one counts:
// - from the samples of each run (MOVER: Zou & Donner 2008). For ratios on logarithms, widened to contain the
//   ratio of the means. For late and lost messages from all repetitions together;
// - from how much repetitions differ: Student's t with one variance for both sides.
// If both sides have two runs or more, the second counts alone where the first has no limit: the p99 of short
// runs has no limit, but many short runs show how it varies.
// Without repetitions on both sides, changes from one start to the next (memory placement, start order) are
// unknown. The interval is then about these runs only, without a verdict.
// Verdicts, gates, tables and figures use the interval of the ratio, or without a ratio that of the
// difference. The two may disagree if repetitions differ much.
enum class Tendency { less, unclear, more };        // what the interval excludes
enum class Verdict { better, cannot_tell, worse };  // less is better
struct Change {
  double from = 0, to = 0;
  bool repeated = false;        // both sides have two runs or more
  Interval difference_lies;     // that of to − from
  std::optional<double> ratio;  // to / from; nothing where one is not positive
  Interval ratio_lies;
  bool is_of_unequal_numbers = false;  // of values: two maxima that cannot be compared
  Tendency tendency = Tendency::unclear;
  // What verdicts and gates go by.
  const Interval& lies() const { return ratio ? ratio_lies : difference_lies; }
  Verdict verdict() const;
};
// Nothing: one of the sides does not have the metric, or too few values for it.
std::optional<Change> change(const std::vector<const Summary*>& from, const std::vector<const Summary*>& to,
                             Times, Figure);

// Whether a limit is passed, for gates. A change passes it if the measured one does and chance does not
// explain it: the interval excludes no change (or, where a limit asks for an improvement, it excludes that
// improvement). Without any change the answer is yes in at most 1 % of cases. A single metric passes
// a limit if its interval lies beyond.
enum class Answer { no, cannot_tell, yes };
Answer ratio_exceeds(const Change&, double limit);       // 1.1 for `p99 > +10 %`
Answer difference_exceeds(const Change&, double limit);  // if there is a ratio, the limit is converted to one
Answer exceeds(const Measured&, double limit);

// A quantity that was found several times, and the interval of its median. The interval runs between two
// order statistics and covers the median with the stated probability whatever the distribution (sign test;
// Conover 1999, ch. 3.2): the narrowest symmetric one of at least 95 %, or, of fewer than six values, all
// that they span.
struct Estimate {
  std::size_t count = 0;
  double median = 0, low = 0, high = 0;
  double confidence = 0;
};
std::optional<Estimate> estimate(std::vector<double> values);  // nothing if `values` is empty

// What one layer of a stack costs a message: a run against its baseline, repetition by repetition of one
// session. `added` is the median of those differences; nothing for the lowest layer.
struct Cost {
  std::optional<Estimate> total, added;
};
// Of the complete runs with the same key, of all sessions in a file.
struct Layer {
  const Summary* run = nullptr;   // the first of them; points into what was given
  const Summary* base = nullptr;  // of the layer below
  std::string adds_to;            // its id, as requested; empty for the lowest layer
  std::string no_base;            // why the requested base is missing, for people
  Cost round_trip_ns;             // the median message's
  Cost cpu_ns;                    // per message, of all recorded threads on both hosts
  Cost instructions;              // per message; nothing if they were not counted
};
struct Layers {
  // In the order of their first runs; without runs that neither have a baseline nor are one.
  std::vector<Layer> measured;
  struct Missing {
    std::string id, reason;  // reason empty: nothing was recorded
  };
  std::vector<Missing> missing;  // ids without a complete run
};
// A layer's base is the run with its baseline's id that has the same conditions, except for transport,
// options and receiving method; of several, the run that shares most of these.
Layers layers(const std::vector<Summary>&);

}  // namespace ontime::statistics

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
  std::int64_t response_max_ns = 0;                 // of the cycles due here, skipped ones too
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
  std::int64_t slice_ns = 0;  // how long a slice is; longer in a run that is longer than it said
  std::vector<Slice> slices;  // from the first message on; at most 2,000
  std::vector<Worst> worst;   // at most 10, the longest first; lost messages are not among them
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
  bool is_lower_bound(std::int64_t percentile_ns) const {
    return beyond > 0 && percentile_ns == beyond_from_ns;
  }
};

// Of one run. sent = on_time + late + lost.
struct Summary {
  record::Run run;
  std::vector<record::Note> notes;
  std::int64_t start_ns = 0;  // when its first message was due: the client's clock, as that of notes
  std::uint64_t sent = 0, on_time = 0, late = 0, lost = 0;
  std::uint64_t skipped_cycles = 0;  // those after the last message among them
  // So many messages at the end were not answered, the first of which was due then.
  std::uint64_t unanswered_at_end = 0;
  std::int64_t unanswered_from_ns = 0;
  // Cycles without an answer within the deadline from when they were due, where the record has a deadline:
  // responses above it, and lost messages. Of sent + skipped_cycles.
  std::optional<std::uint64_t> late_by_response;
  Distribution round_trip;  // sent → received: the paper's T2 − T1
  // Due → answered, of every cycle, those that passed without a message among them: until the answer that
  // ended their wait, or, if none did any more, as long as they are known to have waited. Hides no stall. A
  // lost message has none.
  Distribution response;
  std::int64_t open_wait_ns = 0;  // the longest of the waits that no answer ended; 0: of cycles there is none
  // Due → woke, of the sending thread; none in back-to-back. Of the wake-ups for the cycles skipped before a
  // message the longest counts as one.
  Distribution wake_up;
  Distribution server;         // received → sent, on the server's clock; count 0 if the server did not say
  std::optional<Parts> parts;  // not guessed: nothing, unless the record says that the clocks permit it
  std::string no_parts;        // why they were left out all the same, for users
  std::optional<Imported> imported;
  // Its samples are only those around the worst messages; all counts, and the distributions to within 1.6 %,
  // are of all messages.
  bool has_worst_only = false;
  Shape shape;

  // Their intervals: confidence.hpp. Where samples are missing these have no intervals, no messages and no
  // bound, because those are unknown.
  Certainty round_trip_certainty, response_certainty;
  // Of a message, to be answered late, not at all, and either of the two.
  Probability late_probability, lost_probability, missed_probability;
  Probability late_by_response_probability;  // of a cycle; no messages where late_by_response is nothing
  Bursts bursts;
  Extremes extremes;            // of the round trips: extremes.hpp
  double message_every_ns = 0;  // on average; 0 of fewer than two
};
Summary summarise(const record::Reader&, const record::Run&);
// "from about 100 s on the median is 2.0 times as long (150 µs, then 300 µs)". Empty: it did not change for
// good.
std::string shift_text(const Summary&);
std::string time_of(double ns);  // "28.25 ms"
// Of all runs but the first `known`.
std::vector<Summary> summarise(const record::Reader&, std::size_t known = 0);

// For listened messages some counts are unknown: without a limit no message counts as late, and not every
// source shows losses. An unknown count has a probability with 0 messages.
inline bool knows_late(const record::Run& run) {
  return !run.asked.is_listened() || run.asked.task.client.deadline.count() > 0;
}
inline bool knows_loss(const record::Run& run) { return !run.outcome.loss_unknown; }

// Measured to its end: not cut off, interrupted or failed.
inline bool is_complete(const record::Run& run) {
  return run.outcome.document.is_object() && !run.outcome.error && !run.outcome.interrupted;
}
// So many messages' samples were not recorded: no figure speaks for all messages, and nothing bounds
// it is.
inline std::uint64_t unrecorded(const record::Run& run) { return run.outcome.counters.dropped_records; }

// In ns, or, of late and lost, the share of all messages (of late by response: of all cycles). `max` is the
// greatest that was seen and has no interval.
std::optional<Measured> measured(const Summary&, Times, Figure);  // nothing: nothing was answered, or sent
// Of late and lost messages; nothing of times.
const Probability* probability_of(const Summary&, Times, Figure);

// Where not all ranks are kept, a number of messages lies between two: the same one where it is known.
struct Between {
  Probability at_least, at_most;
};
// How many of the answers take longer than that: exactly of the slowest 128, else to within 2.2 %. Their
// design effect is the greater one of the percentiles around; of hardly any, that of the slowest.
Between slower_than(const Summary&, Times, double limit_ns);

// From one or several runs to one or several others: their means. Of the maximum the greatest of all runs,
// without intervals. A percentile that a run has too few values for is unknown.
//
// Each end of an interval is passed by the truth at most once in a hundred. Two intervals are computed, and
// the wider one counts:
// - by what the samples of each run tell (MOVER: Zou & Donner 2008; of ratios on the logarithms, widened so
// that
//   they hold the ratio of the means; of late and lost messages those of all repetitions counted together);
// - by how much repetitions differ: Student's t with one variance for both sides.
// Where both sides have two runs or more, the second stands alone if the first has no end: short runs leave
// their p99 open, but many short runs show how it varies.
// Without repetitions on both sides nothing is known of what changes from one start to the next (placement in
// memory, the order of start). The interval is then about these runs only, and there is no verdict.
// The interval of the ratio decides what has changed, for verdicts and gates; that of the difference where
// there is no ratio. The two may disagree where repetitions differ much.
enum class Tendency { less, unclear, more };        // what the interval excludes
enum class Verdict { better, cannot_tell, worse };  // less is better
struct Change {
  double from = 0, to = 0;
  bool repeated = false;        // both sides have two runs or more
  Interval difference_lies;     // that of to − from
  std::optional<double> ratio;  // to / from; nothing where one is not positive
  Interval ratio_lies;
  Tendency tendency = Tendency::unclear;
  Verdict verdict() const;
};
// Nothing: one of the sides does not have it, or too few values for it.
std::optional<Change> change(const std::vector<const Summary*>& from, const std::vector<const Summary*>& to,
                             Times, Figure);

// Whether a limit is passed, for gates. A change passes it if the measured one does and chance does not
// explain it: the interval excludes no change (or, where a limit asks for an improvement, it excludes that
// improvement). Where nothing has changed the answer is yes at most once in a hundred. A single metric passes
// a limit if its interval lies beyond.
enum class Answer { no, cannot_tell, yes };
Answer ratio_exceeds(const Change&, double limit);       // 1.1 for `p99 > +10 %`
Answer difference_exceeds(const Change&, double limit);  // where there is a ratio, of the limit as one
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
std::optional<Estimate> estimate(std::vector<double> values);  // nothing of nothing

// What one layer of a stack costs a message: a run against its baseline, repetition by repetition of one
// session. `added` is the median of those differences; nothing for the lowest layer.
struct Cost {
  std::optional<Estimate> total, added;
};
// Of the complete runs with the same key, of all sessions in a file.
struct Layer {
  const Summary* run = nullptr;   // the first of them; points into what was given
  const Summary* base = nullptr;  // of the layer below
  std::string adds_to;            // its id, as asked; empty for the lowest layer
  std::string no_base;            // why there is no base though one was asked for, for people
  Cost round_trip_ns;             // the median message's
  Cost cpu_ns;                    // a message, of all recorded threads on both hosts
  Cost instructions;              // the same; nothing where they were not counted
};
struct Layers {
  // In the order in which they were first run; what neither adds to another nor is added to is left out.
  std::vector<Layer> measured;
  struct Missing {
    std::string id, reason;  // nothing was recorded: no reason
  };
  std::vector<Missing> missing;  // ids of which there is no complete run
};
// A layer's base is the run with its baseline's id that has the same conditions, except for transport,
// options and receiving method; of several, the run that shares most of these.
Layers layers(const std::vector<Summary>&);

}  // namespace ontime::statistics

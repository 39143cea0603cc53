// SPDX-License-Identifier: Apache-2.0
#include "statistics/statistics.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <functional>
#include <future>
#include <utility>

#include <fmt/format.h>

#include "statistics/clocks.hpp"
#include "statistics/course.hpp"
#include "statistics/imported.hpp"
#include "statistics/lost_wait.hpp"
#include "statistics/shape.hpp"
#include "statistics/values.hpp"

namespace ontime::statistics {
namespace {

using roundtrip::Fate;
using roundtrip::Sample;

constexpr std::size_t block_size = 1 << 14;  // of samples

// Nothing of a time that was not stated.
std::optional<std::int64_t> positive_ns(std::chrono::nanoseconds time) {
  return time.count() > 0 ? std::optional(time.count()) : std::nullopt;
}

// By when each was due.
Series skipped_before(const Sample& sample) {
  const auto span_ns = between(sample.intended_ns, sample.due_ns);
  return Series::of(sample.intended_ns, span_ns / std::max<std::int64_t>(sample.skipped_cycles, 1),
                    sample.skipped_cycles);
}

// When answered messages were due: of every so-many-th, in bounded memory.
class Answered {
 public:
  void add(std::int64_t due_ns) {
    if (count_++ % every_ != 0) return;
    due_ns_.push_back(due_ns);
    if (due_ns_.size() < most) return;
    for (std::size_t i = 0; i < most / 2; ++i) due_ns_[i] = due_ns_[2 * i];
    due_ns_.resize(most / 2);
    every_ *= 2;
  }
  // Of the answer of this number, from 0, or of one of the next few.
  std::int64_t due_of(std::uint64_t number) const {
    return due_ns_[std::min<std::uint64_t>((number + every_ - 1) / every_, due_ns_.size() - 1)];
  }

 private:
  static constexpr std::size_t most = 4096;
  std::vector<std::int64_t> due_ns_;
  std::uint64_t count_ = 0, every_ = 1;
};

// What is gathered of a run while its samples go by, once it is known when the first was due.
class Pass {
 public:
  Pass(Summary& summary, std::int64_t start_ns)
      : summary_(summary),
        asked_(summary.run.asked.task.client),
        timeout_ns_(positive_ns(asked_.timeout)),
        deadline_ns_(positive_ns(asked_.deadline)),
        has_cycles_(asked_.schedule != roundtrip::Schedule::back_to_back),
        parts_(summary.run.outcome),
        timeline_(start_ns, positive_ns(asked_.duration)),
        worst_(timeout_ns_) {}

  void message(const Sample& sample) {
    if (sample.index != next_) cut();
    next_ = sample.index + 1;
    ++summary_.sent;
    if (has_cycles_) {
      wake_up_.add(between(sample.due_ns, sample.woke_ns));
      if (sample.passed_wake_ns > 0) wake_up_.add(sample.passed_wake_ns);
    }
    if (sample.skipped_cycles > 0) skip(skipped_before(sample));
    timeline_.message(sample);
    worst_.message(sample);
    misses_.message(sample);
    if (summary_.sent == 1) first_due_ns_ = sample.due_ns;
    last_due_ns_ = sample.due_ns;
    if (sample.fate == Fate::lost) {
      ++summary_.lost;
      if (summary_.unanswered_at_end++ == 0) summary_.unanswered_from_ns = sample.due_ns;
      late_by_response_.add(true);
      waited_until_ns_ = nth_after(sample.sent_ns, timeout_ns_.value_or(0), 1);
      if (timeout_ns_) lost_wait_.lost(sample.due_ns, waited_until_ns_);
      return;
    }
    summary_.unanswered_at_end = 0;
    answered_.add(sample.due_ns);
    ++(sample.fate == Fate::late ? summary_.late : summary_.on_time);
    answer_waiting(sample.received_ns);
    if (const auto wait = lost_wait_.answered(sample.received_ns)) keep(*wait);
    const auto response_ns = between(sample.due_ns, sample.received_ns);
    response_.add(response_ns);
    response_course_.add(response_ns);
    const bool is_late = response_ns > deadline_ns_.value_or(0);
    late_by_response_.add(is_late);
    late_by_response_only_ += is_late && sample.fate == Fate::on_time ? 1 : 0;
    const auto round_trip_ns = between(sample.sent_ns, sample.received_ns);
    round_trip_.add(round_trip_ns);
    round_trip_course_.add(round_trip_ns);
    if (!has_server_times(sample)) return;
    server_.add(between(sample.server_received_ns, sample.server_sent_ns));
    parts_.message(sample);
  }

  void finish() && {
    const auto& counted = summary_.run.outcome.counters;
    if (counted.sent > next_) cut();
    if (counted.trailing_cycles > 0 && counted.trailing_cycles < most_trailing) {
      skip(Series::of(counted.trailing_due_ns, positive_ns(asked_.period).value_or(0),
                      counted.trailing_cycles));
      waited_until_ns_ = std::max(waited_until_ns_, counted.trailing_until_ns);
    }
    // Those that no answer came to waited at least so long.
    const auto until_ns =
        waiting_.empty() ? waited_until_ns_ : std::max(waited_until_ns_, waiting_.back().greatest());
    leave_waiting(until_ns);
    if (const auto wait = lost_wait_.ended(until_ns)) keep(*wait);
    std::move(parts_).into(summary_);
    summary_.wake_up = Ranks(std::move(wake_up_)).distribution();
    summary_.server = Ranks(std::move(server_)).distribution();
    Ranks round_trips(std::move(round_trip_)), responses(std::move(response_));
    summary_.round_trip = round_trips.distribution();
    summary_.response = responses.distribution();
    summary_.round_trip_certainty =
        certainty(round_trip_course_, round_trips, summary_.round_trip, timeout_ns_);
    const auto answers = round_trips.count();
    const auto peaks = std::min<std::uint64_t>(answers / 10, most_peaks);
    summary_.extremes =
        extremes(round_trip_course_.values(), static_cast<float>(round_trips.at_rank(answers - peaks)));
    summary_.response_certainty = certainty(response_course_, responses, summary_.response);
    // Where hardly any is late, how the slowest come in bursts is all that there is to go by.
    const auto effect = summary_.response_certainty.slowest_effect;
    std::move(misses_).into(summary_, effect);
    if (deadline_ns_) {
      summary_.late_by_response_probability = probability(late_by_response_.all(), effect);
      summary_.late_by_response = summary_.late_by_response_probability.events;
      // The record may lack it: its ontime did not count it.
      auto& only = summary_.run.outcome.late_by_response_only;
      only = std::max(only, late_by_response_only_);
    }
    if (summary_.sent > 1)
      summary_.message_every_ns =
          static_cast<double>(between(first_due_ns_, last_due_ns_)) / static_cast<double>(summary_.sent - 1);
    // Samples that were removed from the file later are missing as those that were never written.
    auto& dropped = summary_.run.outcome.counters.dropped_records;
    if (counted.sent > summary_.sent) dropped = std::max(dropped, counted.sent - summary_.sent);
    if (const auto missing = unrecorded(summary_.run); missing > 0) forget_how_sure(missing);
    auto& shape = summary_.shape;
    shape.round_trip = round_trips.histogram();
    shape.response = responses.histogram();
    shape.round_trip_ranks = round_trips.some();
    shape.response_ranks = responses.some();
    std::move(timeline_).into(shape);
    if (auto& shift = summary_.round_trip_certainty.shift) {
      const auto first = static_cast<std::uint64_t>(shift->share * static_cast<double>(answers));
      shift->from_ns = static_cast<double>(between(summary_.start_ns, answered_.due_of(first)));
    }
    shape.worst = std::move(worst_).longest_first();
  }

 private:
  void keep(const LostWait::Wait& wait) {
    auto& longest = wait.is_open ? summary_.open_wait_ns : summary_.lost_wait_ns;
    longest = std::max(longest, wait.ns);
  }

  // Samples are missing: an answer to one of these messages may have ended what waits, and a burst. Skipped
  // cycles are known to have waited until the last message before these was sent.
  void cut() {
    misses_.end_burst();
    summary_.unanswered_at_end = 0;
    if (const auto wait = lost_wait_.cut()) keep(*wait);
    leave_waiting(between(timeout_ns_.value_or(0), waited_until_ns_));
  }

  void skip(const Series& cycles) {
    summary_.skipped_cycles += cycles.count;
    timeline_.skipped(cycles);
    waiting_.push_back(cycles);
  }

  // Samples go missing where a machine is busiest, and not by chance.
  void forget_how_sure(std::uint64_t missing) {
    for (auto* certainty : {&summary_.round_trip_certainty, &summary_.response_certainty}) {
      certainty->shift.reset();
      certainty->mean = Measured{certainty->mean.value, {}, {}};
      for (auto& percentile : certainty->quantiles) percentile = Measured{percentile.value, {}, {}};
    }
    for (auto* probability : {&summary_.late_probability, &summary_.lost_probability,
                              &summary_.missed_probability, &summary_.late_by_response_probability})
      *probability = {};
    summary_.extremes = {};
    summary_.extremes.refused =
        fmt::format("{} {} not recorded", missing, missing == 1 ? "sample was" : "samples were");
  }

  // The answer that those who wait have waited for.
  void answer_waiting(std::int64_t at_ns) {
    for (const auto& cycles : waiting_) {
      const auto responses = Series::of(between(cycles.greatest(), at_ns), cycles.step, cycles.count);
      response_.add_series(responses);
      response_course_.add_series(responses);
      late_by_response_.add(
          {static_cast<double>(responses.count),
           static_cast<double>(responses.count - responses.at_most(deadline_ns_.value_or(0)))});
      timeline_.answered(cycles, at_ns);
    }
    waiting_.clear();
  }

  // No answer is known that ended the wait.
  void leave_waiting(std::int64_t until_ns) {
    if (waiting_.empty()) return;
    keep({waiting_.front().least, between(waiting_.front().least, until_ns), true});
    answer_waiting(until_ns);
  }

  Summary& summary_;
  const roundtrip::ClientOptions& asked_;
  const std::optional<std::int64_t> timeout_ns_, deadline_ns_;
  const bool has_cycles_;
  Values round_trip_, response_, wake_up_, server_;
  RoundTripParts parts_;
  Timeline timeline_;
  WorstOnes worst_;
  Misses misses_;
  Answered answered_;
  Course round_trip_course_, response_course_;
  Batches late_by_response_;                 // of each cycle
  std::uint64_t late_by_response_only_ = 0;  // messages
  std::int64_t first_due_ns_ = 0, last_due_ns_ = 0;
  std::uint64_t next_ = 0;            // index of the next message, unless samples are missing
  std::vector<Series> waiting_;       // cycles, for the next answer
  std::int64_t waited_until_ns_ = 0;  // at least, if no answer came
  LostWait lost_wait_;
};

}  // namespace

std::string time_of(double ns, int digits) {
  const double size = std::abs(ns);
  if (size >= 9999.5e9) return fmt::format("{:.0f} s", ns / 1e9);  // without an exponent
  const auto [unit_ns, unit] = size >= 1e9   ? std::pair(1e9, "s")
                               : size >= 1e6 ? std::pair(1e6, "ms")
                                             : std::pair(1e3, "µs");
  return fmt::format("{:.{}g} {}", ns / unit_ns, size >= 999 * unit_ns ? std::max(digits, 4) : digits, unit);
}

std::string shift_text(const Summary& summary) {
  const auto& shift = summary.round_trip_certainty.shift;
  if (!shift) return "";
  const double from_s = shift->from_ns.value_or(0) / 1e9;
  return fmt::format("the median {} from {} to {} at {:.{}f} s",
                     shift->after_ns < shift->before_ns ? "falls" : "rises", time_of(shift->before_ns),
                     time_of(shift->after_ns), from_s, from_s < 10 ? 1 : 0);
}

Fates fates_of(const Summary& summary) {
  const auto counted = unrecorded(summary.run) > 0 ? summary.run.outcome.counters : roundtrip::Counters();
  const auto late = std::max(summary.late, counted.late), lost = std::max(summary.lost, counted.lost);
  return {std::max(summary.sent, counted.sent), late, lost,
          std::max(summary.skipped_cycles, counted.skipped_cycles),
          std::max(summary.late_by_response.value_or(0), late + lost)};
}

Summary summarise(const record::Reader& reader, const record::Run& run) {
  Summary summary;
  summary.run = run;
  summary.notes = reader.notes(run.number);
  if (run.asked.imported) {
    summarise_imported(summary);
    return summary;
  }
  std::optional<Pass> pass;
  const auto account = [&](const std::vector<Sample>& block) {
    for (const auto& sample : block) {
      if (!pass) {
        summary.start_ns = run.start_ns.value_or(sample.intended_ns);
        pass.emplace(summary, summary.start_ns);
      }
      pass->message(sample);
    }
  };
  // While a block is accounted for, the next is read.
  std::vector<Sample> block, other;
  std::future<void> at_work;
  reader.each_sample(run.number, [&](const Sample& sample) {
    block.push_back(sample);
    if (block.size() < block_size) return;
    if (at_work.valid()) at_work.get();
    std::swap(block, other);
    block.clear();
    at_work = std::async(std::launch::async, account, std::cref(other));
  });
  if (at_work.valid()) at_work.get();
  account(block);
  if (!pass) {
    summary.start_ns = run.start_ns.value_or(run.outcome.counters.trailing_due_ns);
    pass.emplace(summary, summary.start_ns);
  }
  std::move(*pass).finish();
  if (run.asked.keeps_worst()) summarise_worst(summary);
  return summary;
}

std::vector<Summary> summarise(const record::Reader& reader, std::size_t known) {
  const auto runs = reader.runs();
  std::vector<Summary> summaries;
  for (std::size_t i = known; i < runs.size(); ++i) summaries.push_back(summarise(reader, runs[i]));
  return summaries;
}

}  // namespace ontime::statistics

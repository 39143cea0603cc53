// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <deque>
#include <filesystem>
#include <system_error>
#include <utility>

#include "statistics/wrapping.hpp"
#include "watch/watch.hpp"

namespace ontime::watch {
namespace {

using roundtrip::Fate;
using roundtrip::Sample;
using statistics::between;
using statistics::LostWait;
using statistics::nth_after;

constexpr std::int64_t may_change_ns = 2'000'000'000;  // a lost message may prove answered within this time
// A flight recorder knows within 5 s that a message is one of the worst.
constexpr std::int64_t may_be_kept_ns = 6'000'000'000;
constexpr std::size_t most_worst = 3;

// Whether the coordinator noted at the start that samples come after the run, so that they do not disturb the
// link.
bool samples_wait(const record::Reader& reader, std::int64_t run) {
  const auto notes = reader.notes(run);
  return std::ranges::any_of(notes, [](const auto& note) { return note.kind == "samples-wait"; });
}

void keep(Counted& all, const Worst& wait) {
  if (all.worst.size() == most_worst && wait.response_ns <= all.worst.back().response_ns) return;
  all.worst.push_back(wait);
  std::ranges::stable_sort(all.worst, std::ranges::greater(), &Worst::response_ns);
  if (all.worst.size() > most_worst) all.worst.pop_back();
}

// No answer is known that ended the wait. Skipped cycles waited at least until then.
void leave_open(Counted& all, std::optional<LostWait::Wait> wait, std::int64_t until_ns,
                std::optional<std::int64_t> start_ns) {
  if (const auto since_ns = std::exchange(all.waiting_since_ns, {})) {
    const auto skipped_ns = between(*since_ns, until_ns);
    all.response_max_ns = std::max(all.response_max_ns, std::optional(skipped_ns));
    if (!wait || wait->ns < skipped_ns) wait = {*since_ns, skipped_ns, true};
  }
  if (!wait) return;
  const auto at_ns = between(start_ns.value_or(wait->since_ns), wait->since_ns);
  keep(all, {{}, static_cast<double>(at_ns) / 1e9, 0, wait->ns});
}

// Samples are missing: an answer to one of these messages may have ended what waits. Skipped cycles are known
// to have waited until the last message before these was sent.
void cut(Counted& all, std::optional<std::int64_t> start_ns, std::int64_t timeout_ns) {
  leave_open(all, all.lost_wait.cut(), between(timeout_ns, all.waited_until_ns), start_ns);
}

void add(Counted& all, const Sample& sample, std::int64_t start_ns, std::int64_t timeout_ns) {
  const auto at_s = [&](std::int64_t due_ns) { return static_cast<double>(between(start_ns, due_ns)) / 1e9; };
  if (sample.index != all.next_message) cut(all, start_ns, timeout_ns);
  all.next_message = sample.index + 1;
  ++all.sent;
  all.skipped_cycles += sample.skipped_cycles;
  if (sample.skipped_cycles > 0 && !all.waiting_since_ns) all.waiting_since_ns = sample.intended_ns;
  if (sample.fate == Fate::lost) {
    ++all.lost;
    all.waited_until_ns = nth_after(sample.sent_ns, timeout_ns, 1);
    if (timeout_ns > 0) all.lost_wait.lost(sample.due_ns, all.waited_until_ns);
    return;
  }
  ++(sample.fate == Fate::late ? all.late : all.on_time);
  const auto round_trip_ns = sample.received_ns - sample.sent_ns;
  all.round_trip.add(round_trip_ns);
  const auto due_ns = std::exchange(all.waiting_since_ns, {}).value_or(sample.due_ns);
  const auto response_ns = between(due_ns, sample.received_ns);
  all.response_max_ns = std::max(all.response_max_ns, std::optional(response_ns));
  const auto lost = all.lost_wait.answered(sample.received_ns);
  if (lost && lost->is_open) keep(all, {{}, at_s(lost->since_ns), 0, lost->ns});
  const bool waited_longer = lost && !lost->is_open && lost->ns > response_ns;
  keep(all, {sample.index, at_s(waited_longer ? lost->since_ns : due_ns), round_trip_ns,
             waited_longer ? lost->ns : response_ns});
}

// What no sample shows, as statistics have it: cycles skipped after the last message, and a wait that no
// answer ended.
void add_end(Counted& all, const record::Run& run, std::optional<std::int64_t> start_ns,
             std::int64_t timeout_ns) {
  const auto& counted = run.outcome.counters;
  if (counted.sent > all.next_message) cut(all, start_ns, timeout_ns);
  if (counted.trailing_cycles > 0 && counted.trailing_cycles < statistics::most_trailing) {
    const auto period_ns = std::max<std::int64_t>(run.asked.task.client.period.count(), 0);
    all.skipped_cycles += counted.trailing_cycles;
    if (!all.waiting_since_ns) all.waiting_since_ns = counted.trailing_due_ns;
    all.waited_until_ns =
        std::max({all.waited_until_ns, counted.trailing_until_ns,
                  nth_after(counted.trailing_due_ns, period_ns, counted.trailing_cycles - 1)});
  }
  leave_open(all, all.lost_wait.ended(all.waited_until_ns), all.waited_until_ns, start_ns);
}

// Messages whose samples are missing: the client counted them. Returns how many.
std::uint64_t add_unrecorded(Counted& all, const roundtrip::Counters& counted) {
  const auto missing = std::max(counted.dropped_records, counted.sent - std::min(counted.sent, all.sent));
  if (missing == 0) return 0;
  all.sent = std::max(all.sent, counted.sent);
  all.late = std::max(all.late, counted.late);
  all.lost = std::max(all.lost, counted.lost);
  all.on_time = all.sent - std::min(all.sent, all.late + all.lost);
  all.skipped_cycles = std::max(all.skipped_cycles, counted.skipped_cycles);
  return missing;
}

// Where only the worst are kept, the outcome has the times of all: each rounded, but their mean and their
// maximum as they are.
Buckets times_in(const record::Counts& counted) {
  constexpr auto most = std::uint64_t{1} << 60;  // of a damaged file: more is neither a time nor a count
  Buckets times;
  for (const auto& value : counted.values) {
    if (!value.is_array() || value.size() != 2 || !value[0].is_number_unsigned() ||
        !value[1].is_number_unsigned())
      continue;
    const auto ns = value[0].get<std::uint64_t>(), count = value[1].get<std::uint64_t>();
    if (ns <= most && count > 0 && count <= most - std::min(times.count(), most))
      times.add(static_cast<std::int64_t>(ns), count);
  }
  const auto max_ns = counted.max_ns.value_or(-1);
  const auto mean_ns = counted.mean_ns.value_or(-1);
  if (times.count() > 0 && max_ns <= static_cast<std::int64_t>(most) && mean_ns >= 0 &&
      mean_ns <= static_cast<double>(max_ns))
    times.correct(max_ns, mean_ns);
  return times;
}

}  // namespace

void Follower::begin(const record::Run& run) {
  constexpr std::size_t most_before = 16;
  if (is_over_) before_.push_back(std::move(progress_));
  if (before_.size() > most_before) before_.pop_front();
  is_over_ = false;
  settled_ = {};
  start_ns_.reset();
  progress_ = {};
  progress_.run = run;
  if (const auto duration = run.asked.task.client.duration; duration.count() > 0)
    progress_.duration_s = static_cast<double>(duration.count()) / 1e9;
}

const Progress& Follower::look() {
  try {
    look_once();
  } catch (const record::Error&) {
    if (!seen_) throw;
    look_once();  // the writer may have removed a run, or the file, meanwhile
  }
  return progress_;
}

void Follower::look_once() {
  std::error_code ignored;
  if (seen_ && std::filesystem::status(results_, ignored).type() == std::filesystem::file_type::not_found) {
    progress_.state = Progress::State::ended;
    progress_.samples_wait = false;
    progress_.lost_for_good = progress_.lost;
    return;
  }
  const bool is_written = record::is_being_written(
      results_);  // checked before reading: if the writer ends meanwhile, the next look sees it
  const record::Reader reader(results_);
  seen_ = true;
  auto runs = reader.runs(std::max<std::int64_t>(progress_.run.number, 1));
  if (runs.empty() && progress_.run.number > 0) {  // the run was removed
    begin({});
    runs = reader.runs(1);
  }
  if (!runs.empty()) {
    // The next run can have the number of a removed run, whose samples are gone.
    const auto is_current = [&](const record::Run& run) {
      return run.number == progress_.run.number && run.asked.document == progress_.run.asked.document;
    };
    // A run that a later one has outlived was cut off: those of several components end together. A recording
    // begins a run with each flow, and ends all at last: the newest is shown.
    const auto& first = runs.front();
    const auto has_ended = [](const record::Run& run) { return run.outcome.has_ended(); };
    const bool is_outlived = !has_ended(first) && std::ranges::any_of(runs, has_ended);
    const auto& seen = !is_current(first) || first.asked.is_listened() ? runs.back()
                       : (is_over_ || is_outlived) && runs.size() > 1  ? runs[1]
                                                                       : first;
    if (!is_current(seen)) begin(seen);
    progress_.run = seen;
  }

  const bool keeps_worst = progress_.run.asked.keeps_worst();
  const auto timeout_ns = std::max<std::int64_t>(progress_.run.asked.task.client.timeout.count(), 0);
  // Settled samples are added once; newer ones are counted again at each look.
  std::deque<Sample> unsettled;
  if (progress_.run.number > 0)
    reader.each_sample(progress_.run.number, settled_.next_message, [&](const Sample& sample) {
      if (!start_ns_) start_ns_ = progress_.run.start_ns.value_or(sample.intended_ns);
      unsettled.push_back(sample);
      for (; unsettled.front().intended_ns <
             sample.intended_ns - (keeps_worst ? may_be_kept_ns : may_change_ns);
           unsettled.pop_front())
        add(settled_, unsettled.front(), *start_ns_, timeout_ns);
    });
  auto newest = settled_;
  for (const auto& sample : unsettled) add(newest, sample, *start_ns_, timeout_ns);
  if (keeps_worst) {
    newest.round_trip = times_in(progress_.run.outcome.histogram);
    progress_.measured_s = newest.round_trip.sum_ns() / 1e9;  // one period begins where another one ends
    progress_.elapsed_s.reset();
    if (progress_.run.asked.measures == "period") progress_.elapsed_s = progress_.measured_s;
  } else if (!unsettled.empty()) {
    const auto& last = unsettled.back();
    const auto& counted = progress_.run.outcome.counters;
    const auto since_start_s = [&](std::int64_t ns) {
      return static_cast<double>(between(*start_ns_, ns)) / 1e9;
    };
    progress_.elapsed_s = since_start_s(last.intended_ns);
    // Where samples are missing, what came after them may be, too.
    progress_.measured_s = since_start_s(
        std::max({last.due_ns + progress_.run.asked.task.client.period.count(), last.received_ns,
                  counted.sent > newest.sent ? 0 : counted.trailing_until_ns}));
  }
  // The outcome of a flight recorder's run is preliminary.
  const bool has_ended = !is_written || (progress_.run.outcome.has_ended() && !keeps_worst);
  is_over_ = has_ended && progress_.run.number > 0;
  has_next_ = is_over_ && runs.back().number > progress_.run.number;
  if (has_ended) add_end(newest, progress_.run, start_ns_, timeout_ns);
  if (keeps_worst && progress_.run.outcome.counters.sent > 0)  // samples may be newer than these counts
    newest.sent = newest.late = newest.lost = newest.on_time = 0;
  const auto missing = add_unrecorded(newest, progress_.run.outcome.counters);
  progress_.unrecorded = keeps_worst ? 0 : missing;  // it was to keep no others
  static_cast<Counted&>(progress_) = newest;
  progress_.lost_for_good =
      std::max(progress_.lost_for_good, has_ended || keeps_worst ? newest.lost : settled_.lost);
  progress_.samples_wait = !has_ended && newest.sent == 0 && samples_wait(reader, progress_.run.number);
  if (progress_.samples_wait) progress_.elapsed_s.reset();
  const bool under_way = !has_ended && (newest.sent > 0 || progress_.samples_wait);
  progress_.state = !is_written && !has_next_ ? Progress::State::ended
                    : under_way               ? Progress::State::measuring
                                              : Progress::State::waiting;
}

}  // namespace ontime::watch

// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <deque>
#include <filesystem>
#include <system_error>

#include "watch/watch.hpp"

namespace ontime::watch {
namespace {

using roundtrip::Fate;
using roundtrip::Sample;

constexpr std::int64_t may_change_ns = 2'000'000'000;  // a lost message may prove answered within this time
constexpr std::size_t most_worst = 3;

// Whether the coordinator noted at the start that samples come after the run, so that they do not disturb the
// link.
bool samples_wait(const record::Reader& reader, std::int64_t run) {
  const auto notes = reader.notes(run);
  return std::ranges::any_of(notes, [](const auto& note) { return note.kind == "samples-wait"; });
}

void add(Counted& all, const Sample& sample, std::int64_t start_ns) {
  ++all.sent;
  all.skipped_cycles += sample.skipped_cycles;
  if (sample.fate == Fate::lost) {
    ++all.lost;
    return;
  }
  ++(sample.fate == Fate::late ? all.late : all.on_time);
  const auto response_ns = sample.received_ns - sample.intended_ns;
  all.round_trip.add(sample.received_ns - sample.sent_ns);
  all.response_max_ns = std::max(all.response_max_ns, response_ns);
  if (all.worst.size() == most_worst && response_ns <= all.worst.back().response_ns) return;
  all.worst.push_back({sample.index, static_cast<double>(sample.intended_ns - start_ns) / 1e9,
                       sample.received_ns - sample.sent_ns, response_ns});
  std::ranges::stable_sort(all.worst, std::ranges::greater(), &Worst::response_ns);
  if (all.worst.size() > most_worst) all.worst.pop_back();
}

}  // namespace

void Follower::begin(const record::Run& run) {
  settled_ = {};
  start_ns_.reset();
  next_ = 0;
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
    const auto& newest = runs.back();
    // The next run can have the number of a removed run, whose samples are gone.
    if (newest.number != progress_.run.number || newest.asked.document != progress_.run.asked.document)
      begin(newest);
    progress_.run = newest;
  }

  // Settled samples are added once; newer ones are counted again at each look.
  std::deque<Sample> unsettled;
  if (progress_.run.number > 0 && !progress_.run.asked.keeps_worst())
    reader.each_sample(progress_.run.number, next_, [&](const Sample& sample) {
      if (!start_ns_) start_ns_ = sample.intended_ns;
      unsettled.push_back(sample);
      for (; unsettled.front().intended_ns < sample.intended_ns - may_change_ns; unsettled.pop_front()) {
        add(settled_, unsettled.front(), *start_ns_);
        next_ = unsettled.front().index + 1;
      }
    });
  auto newest = settled_;
  for (const auto& sample : unsettled) add(newest, sample, *start_ns_);
  if (!unsettled.empty()) {
    const auto& last = unsettled.back();
    const auto& counted = progress_.run.outcome.counters;
    const auto since_start_s = [&](std::int64_t ns) { return static_cast<double>(ns - *start_ns_) / 1e9; };
    progress_.elapsed_s = since_start_s(last.intended_ns);
    // Where samples are missing, what came after them may be, too.
    progress_.measured_s = since_start_s(
        std::max({last.due_ns + progress_.run.asked.task.client.period.count(), last.received_ns,
                  counted.sent > newest.sent ? 0 : counted.trailing_until_ns}));
  }
  static_cast<Counted&>(progress_) = newest;
  const bool has_ended = !is_written || progress_.run.outcome.has_ended();
  progress_.lost_for_good = has_ended ? newest.lost : settled_.lost;
  progress_.samples_wait = !has_ended && newest.sent == 0 && samples_wait(reader, progress_.run.number);
  const bool under_way = !has_ended && (newest.sent > 0 || progress_.samples_wait);
  progress_.state = !is_written ? Progress::State::ended
                    : under_way ? Progress::State::measuring
                                : Progress::State::waiting;
}

}  // namespace ontime::watch

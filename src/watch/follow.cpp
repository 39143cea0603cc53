// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <deque>
#include <filesystem>
#include <system_error>
#include <utility>

#include "watch/watch.hpp"

namespace ontime::watch {
namespace {

using roundtrip::Fate;
using roundtrip::Sample;

constexpr std::int64_t may_change_ns =
    2'000'000'000;  // for so long a lost message may prove to have been answered
constexpr std::size_t most_worst = 3;

// As the coordinator says when it begins: what would disturb the link is sent afterwards.
bool samples_wait(const record::Reader& reader, std::int64_t run) {
  const auto notes = reader.notes(run);
  return std::any_of(notes.begin(), notes.end(),
                     [](const auto& note) { return note.kind == "samples-wait"; });
}

}  // namespace

// What does not change any more, and from which message on it may.
class Follower::Course {
 public:
  void add(const Sample& sample) {
    ++sent;
    skipped_cycles += sample.skipped_cycles;
    if (sample.fate == Fate::lost) {
      ++lost;
      return;
    }
    ++(sample.fate == Fate::late ? late : on_time);
    const auto response_ns = sample.received_ns - sample.intended_ns;
    round_trip.add(sample.received_ns - sample.sent_ns);
    response_max_ns = std::max(response_max_ns, response_ns);
    if (worst.size() == most_worst && response_ns <= worst.back().response_ns) return;
    worst.push_back({sample.index, static_cast<double>(sample.intended_ns - *start_ns) / 1e9,
                     sample.received_ns - sample.sent_ns, response_ns});
    std::stable_sort(worst.begin(), worst.end(), [](const Worst& one, const Worst& other) {
      return one.response_ns > other.response_ns;
    });
    if (worst.size() > most_worst) worst.pop_back();
  }

  std::uint64_t sent = 0, on_time = 0, late = 0, lost = 0, skipped_cycles = 0;
  Buckets round_trip;
  std::int64_t response_max_ns = 0;
  std::vector<Worst> worst;
  std::optional<std::int64_t> start_ns;
  std::uint64_t next = 0;
};

Follower::Follower(std::string results) : results_(std::move(results)), course_(std::make_unique<Course>()) {}
Follower::~Follower() = default;

void Follower::begin(const record::Run& run) {
  *course_ = Course();
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
  const bool is_written =
      record::is_being_written(results_);  // before it is read: what ends meanwhile is seen next time
  const record::Reader reader(results_);
  seen_ = true;
  auto runs = reader.runs(std::max<std::int64_t>(progress_.run.number, 1));
  if (runs.empty() && progress_.run.number > 0) {  // it was forgotten
    begin({});
    runs = reader.runs(1);
  }
  if (!runs.empty()) {
    const auto& newest = runs.back();
    // One that was forgotten has left its number to the next, and no samples.
    if (newest.number != progress_.run.number || newest.asked.document != progress_.run.asked.document)
      begin(newest);
    progress_.run = newest;
  }

  // What is settled is added for good, the newest anew each time.
  auto& settled = *course_;
  std::deque<Sample> unsettled;
  if (progress_.run.number > 0 && !progress_.run.asked.keeps_worst())
    reader.each_sample(progress_.run.number, settled.next, [&](const Sample& sample) {
      if (!settled.start_ns) settled.start_ns = sample.intended_ns;
      unsettled.push_back(sample);
      for (; unsettled.front().intended_ns < sample.intended_ns - may_change_ns; unsettled.pop_front()) {
        settled.add(unsettled.front());
        settled.next = unsettled.front().index + 1;
      }
    });
  auto newest = settled;
  for (const auto& sample : unsettled) newest.add(sample);
  if (!unsettled.empty())
    progress_.elapsed_s = static_cast<double>(unsettled.back().intended_ns - *settled.start_ns) / 1e9;
  progress_.sent = newest.sent;
  progress_.on_time = newest.on_time;
  progress_.late = newest.late;
  progress_.lost = newest.lost;
  progress_.skipped_cycles = newest.skipped_cycles;
  progress_.round_trip = newest.round_trip;
  progress_.response_max_ns = newest.response_max_ns;
  progress_.worst = newest.worst;
  const bool has_ended = !is_written || progress_.run.outcome.has_ended();
  progress_.lost_for_good = has_ended ? newest.lost : settled.lost;
  progress_.samples_wait = !has_ended && newest.sent == 0 && samples_wait(reader, progress_.run.number);
  const bool under_way = !has_ended && (newest.sent > 0 || progress_.samples_wait);
  progress_.state = !is_written ? Progress::State::ended
                    : under_way ? Progress::State::measuring
                                : Progress::State::waiting;
}

}  // namespace ontime::watch

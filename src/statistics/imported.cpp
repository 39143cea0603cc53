// SPDX-License-Identifier: Apache-2.0
#include "statistics/imported.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include <fmt/format.h>

#include "statistics/values.hpp"

namespace ontime::statistics {
namespace {

using nlohmann::json;

constexpr std::int64_t most_ns = std::int64_t{1} << 60;
constexpr std::uint64_t most_seen = std::uint64_t{1} << 53U;

class Counted {
 public:
  explicit Counted(const record::Run& run) : run_(run.number), of_(run.outcome.histogram) {
    beyond_ = static_cast<std::uint64_t>(whole(of_.beyond));
    beyond_from_ns_ = whole(of_.beyond_from_ns);
    max_ns_ = whole(of_.max_ns);
    if (beyond_ > most_seen || (beyond_ > 0 && beyond_from_ns_ > max_ns_)) wrong();
    seen_ = beyond_;
    if (!of_.values.is_array() || of_.values.empty()) wrong();
    for (const auto& value : of_.values) add(value);
    if (beyond_ > 0 ? values_.back().first >= beyond_from_ns_ : values_.back().first != max_ns_) wrong();
    if (!of_.mean_ns) wrong();
  }

  Distribution distribution() const {
    Distribution of;
    of.count = seen_;
    of.min = values_.front().first;
    for (const auto& row : percentiles) of[row.figure] = at_rank(row.rank_of(seen_));
    of.max = max_ns_;
    of.mean = *of_.mean_ns;
    return of;
  }
  Values values() const {
    Values all;
    for (const auto& [ns, count] : values_) all.add_series({ns, 0, count});
    return all;
  }

 private:
  [[noreturn]] void wrong() const {
    throw record::WrongFile(fmt::format("run {} has an invalid histogram: the file is damaged.", run_));
  }
  std::int64_t whole(std::optional<std::int64_t> number) const {
    if (!number || *number < 0 || *number > most_ns) wrong();
    return *number;
  }
  void add(const json& value) {
    if (!value.is_array() || value.size() != 2) wrong();
    if (!value[0].is_number_integer() || !value[1].is_number_integer()) wrong();
    const auto ns = whole(value[0].get<std::int64_t>());
    const auto count = static_cast<std::uint64_t>(whole(value[1].get<std::int64_t>()));
    if (count == 0 || count > most_seen || (seen_ += count) > most_seen) wrong();
    if (!values_.empty() && ns <= values_.back().first) wrong();
    values_.emplace_back(ns, count);
  }
  std::int64_t at_rank(std::uint64_t rank) const {
    if (rank == seen_) return max_ns_;
    std::uint64_t below = 0;
    for (const auto& [ns, count] : values_)
      if ((below += count) >= rank) return ns;
    return beyond_from_ns_;
  }

  const std::int64_t run_;
  const record::Counts& of_;
  std::vector<std::pair<std::int64_t, std::uint64_t>> values_;
  std::uint64_t seen_ = 0, beyond_ = 0;
  std::int64_t beyond_from_ns_ = 0, max_ns_ = 0;
};

}  // namespace

void summarise_imported(Summary& summary) {
  const Counted histogram(summary.run);
  const auto& imported = *summary.run.asked.imported;
  const auto& counts = summary.run.outcome.histogram;
  const auto unit_ns = counts.unit_ns.value_or(0);
  summary.wake_up = histogram.distribution();
  summary.imported =
      Imported{imported.from, imported.file, unit_ns >= 1 && unit_ns < 9e18 ? std::llround(unit_ns) : 0,
               static_cast<std::uint64_t>(*counts.beyond), *counts.beyond_from_ns};
}

void summarise_worst(Summary& summary) {
  const auto& outcome = summary.run.outcome;
  const auto& counted = summary.run.outcome.counters;
  if (outcome.has_ended() && summary.sent == counted.sent && counted.dropped_records == 0) return;
  Summary all;
  all.run = summary.run;
  all.notes = std::move(summary.notes);
  all.start_ns = summary.start_ns;
  all.has_worst_only = true;
  // The counts of one moment: a sample that is kept may be newer than these.
  const bool is_counted = counted.sent > 0;
  all.sent = is_counted ? counted.sent : summary.sent;
  all.late = is_counted ? counted.late : summary.late;
  all.lost = is_counted ? counted.lost : summary.lost;
  all.on_time = all.sent - std::min(all.sent, all.late + all.lost);
  if (summary.late_by_response) all.late_by_response = all.late + all.lost;
  // By this what needs all samples is not told of it.
  auto& missing = all.run.outcome.counters.dropped_records;
  missing = std::max<std::uint64_t>({missing, all.sent - std::min(all.sent, summary.sent), 1});
  all.extremes.refused = "only samples around the worst messages are kept";
  all.shape.worst = std::move(summary.shape.worst);
  if (!outcome.histogram.values.is_null()) {
    const Counted histogram(summary.run);
    all.round_trip = all.response = histogram.distribution();
    Ranks ranks(histogram.values());
    all.shape.round_trip = all.shape.response = ranks.histogram();
    all.shape.round_trip_ranks = all.shape.response_ranks = ranks.some();
    for (auto* certainty : {&all.round_trip_certainty, &all.response_certainty}) {
      certainty->mean.value = all.round_trip.mean;
      for (const auto& row : percentiles)
        (*certainty)[row.figure].value = static_cast<double>(all.round_trip[row.figure]);
    }
  }
  summary = std::move(all);
}

}  // namespace ontime::statistics

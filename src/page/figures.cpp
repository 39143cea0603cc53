// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "page/course.hpp"
#include "page/parts.hpp"
#include "report/conditions.hpp"
#include "report/runs.hpp"
#include "report/words.hpp"

namespace ontime::page {
namespace {

using nlohmann::json;
using statistics::Distribution;

// More would make the page too big for a browser: these take 13 MB.
constexpr std::uint64_t most_messages = 5'000'000;

json ns_of(std::chrono::nanoseconds time) {
  return time.count() > 0 ? json(static_cast<double>(time.count())) : json();
}

// A logarithmic axis needs at least 1 ns, even from a damaged file.
std::int64_t drawn(std::int64_t ns) { return std::max<std::int64_t>(ns, 1); }

json json_of(const Distribution& of) {
  if (of.count == 0) return nullptr;
  return {{"min", drawn(of.min)},          {"p50", drawn(of[Figure::p50])},
          {"p99", drawn(of[Figure::p99])}, {"p99.9", drawn(of[Figure::p99_9])},
          {"max", drawn(of.max)},          {"count", of.count}};
}

// [from, to, count] of each bin, in order.
json json_of(const statistics::Histogram& histogram) {
  auto bins = json::array();
  for (const auto& [from_ns, to_ns, count] : histogram) bins.push_back({drawn(from_ns), drawn(to_ns), count});
  return bins;
}

// Of each slice the median, null where nothing was answered; and where cycles passed without a message, how
// many, and how long at most one of them waited: [slice, cycles, ns].
json slices_of(const statistics::Shape& shape) {
  auto medians = json::array(), stalls = json::array();
  for (const auto& slice : shape.slices) {
    if (slice.skipped_cycles > 0)
      stalls.push_back({medians.size(), slice.skipped_cycles, drawn(slice.skipped_wait_max_ns)});
    medians.push_back(slice.sent > slice.lost ? json(drawn(slice.p50_ns)) : json());
  }
  return {{"slice_ns", shape.slice_ns},
          {"medians", medians},
          {"stalls", stalls},
          {"beyond", shape.beyond.size()}};
}

// The greater of the two methods' bounds, where the data allow one.
json bound_of(const statistics::Extremes& extremes) {
  if (!refusal_of(extremes).empty()) return nullptr;
  const statistics::Bound* worst = nullptr;
  for (const auto* bound : {&extremes.maxima, &extremes.peaks})
    if (*bound && (worst == nullptr || (*bound)->level > worst->level)) worst = &**bound;
  if (worst == nullptr || !(worst->level >= 1)) return nullptr;
  const auto drawn_or_null = [](const std::optional<double>& ns) {
    return ns && std::isfinite(*ns) ? json(std::max(*ns, 1.0)) : json();
  };
  return {{"exceedance", extremes.exceedance},
          {"level", worst->level},
          {"low", std::max(worst->level_lies.low.value_or(1), 1.0)},
          {"high", drawn_or_null(worst->level_lies.high)}};
}

json notes_of(const Summary& summary) {
  auto notes = json::array();
  for (const auto& note : summary.notes)
    if (note.at_ns && summary.start_ns != 0)
      notes.push_back({{"at_s", seconds_into(summary, *note.at_ns)}, {"text", word(report::text_of(note))}});
  return notes;
}

json course_of(const record::Reader& reader, const Summary& summary, std::uint64_t of) {
  constexpr std::int64_t longest_ns = 1'000'000'000'000'000;
  const auto& client = summary.run.asked.task.client;
  const bool has_cycles =
      client.schedule != roundtrip::Schedule::back_to_back && client.period.count() < longest_ns;
  Course course(summary.start_ns, has_cycles ? client.period.count() : 0, of);
  // The worst messages alone show no time course.
  if (!summary.has_worst_only)
    reader.each_sample(summary.run.number, [&](const auto& sample) { course.message(sample); });
  return course.packed();
}

json layers_json(const Summaries& summaries) {
  const auto layers = statistics::layers(summaries);
  auto bars = json::array();
  for (const auto& layer : layers.measured) {
    const auto& [total, added] = layer.round_trip_ns;
    if (!total) continue;
    bars.push_back({{"name", word(layer.run->run.asked.id)},
                    {"of", word(layer.run->run.asked.task.transport)},
                    {"total", total->median},
                    {"added", added ? json{added->median, added->low, added->high} : json()}});
  }
  return bars;
}

}  // namespace

json figures_of(const record::Reader& reader, const Summaries& summaries) {
  std::uint64_t messages = 0;
  for (const auto& summary : summaries) messages += summary.sent;
  const auto of = messages / (most_messages + 1) + 1;

  auto runs = json::array();
  const auto groups = by_id(summaries);
  for (const auto& group : groups) {
    const auto labels = labels_apart(group), lines = labels_without_repetition(group, " ", "payload");
    for (std::size_t i = 0; i < group.size(); ++i) {
      const auto& summary = *group[i];
      const auto& asked = summary.run.asked;
      runs.push_back({{"run", summary.run.number},
                      {"ontime", printable(asked.ontime)},
                      {"id", word(asked.id)},
                      {"label", labels[i]},
                      {"line", word(asked.id) + " " + lines[i]},  // against the payload
                      {"quantity", quantity_of(asked)},
                      {"payload_bytes", asked.task.client.payload_bytes},
                      {"deadline_ns", ns_of(asked.task.client.deadline)},
                      {"sent", summary.sent},
                      {"late", summary.late},
                      {"lost", summary.lost},
                      {"round_trip", json_of(summary.round_trip)},
                      {"response", json_of(summary.response)},
                      {"histogram", json_of(summary.shape.round_trip)},
                      {"responses", json_of(summary.shape.response)},
                      {"bound", bound_of(summary.extremes)},
                      {"slices", slices_of(summary.shape)},
                      {"notes", notes_of(summary)},
                      {"course", course_of(reader, summary, of)}});
    }
  }
  return {{"runs", runs}, {"layers", layers_json(summaries)}};
}

}  // namespace ontime::page

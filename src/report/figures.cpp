// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "report/conditions.hpp"
#include "report/course.hpp"
#include "report/runs.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

using nlohmann::json;
using statistics::Distribution;
using statistics::Summary;

// More make a page that no browser wants: of 16 bits each they are 13 MB.
constexpr std::uint64_t most_messages = 5'000'000;

json ns_of(const json& us) {
  return us.is_number() && std::isfinite(us.get<double>()) ? json(us.get<double>() * 1e3) : json();
}

// On a logarithmic axis nothing takes less than a nanosecond, whatever a damaged file says.
std::int64_t drawn(std::int64_t ns) { return std::max<std::int64_t>(ns, 1); }

json json_of(const Distribution& of) {
  if (of.count == 0) return nullptr;
  return {{"min", drawn(of.min)},     {"p50", drawn(of.p50)}, {"p99", drawn(of.p99)},
          {"p99.9", drawn(of.p99_9)}, {"max", drawn(of.max)}, {"count", of.count}};
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
      stalls.push_back({medians.size(), slice.skipped_cycles, drawn(slice.response_max_ns)});
    medians.push_back(slice.sent > slice.lost ? json(drawn(slice.p50_ns)) : json());
  }
  return {{"slice_ns", shape.slice_ns}, {"medians", medians}, {"stalls", stalls}};
}

// Where the data allow one: the later of the two ways'.
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
      notes.push_back(
          {{"at_s", (static_cast<double>(*note.at_ns) - static_cast<double>(summary.start_ns)) / 1e9},
           {"text", word(note.text.empty() ? note.kind : note.text)}});
  return notes;
}

json course_of(const record::Reader& reader, const Summary& summary, std::uint64_t of) {
  const auto& period = ns_of(at(summary.run.asked, "period_us"));
  const bool back_to_back = at(summary.run.asked, "schedule") == "back-to-back";
  const double period_ns = period.is_number() && !back_to_back ? period.get<double>() : 0;
  Course course(summary.start_ns, period_ns > 0 && period_ns < 1e15 ? std::llround(period_ns) : 0, of);
  reader.each_sample(summary.run.number, [&](const auto& sample) { course.message(sample); });
  return course.packed();
}

json layers_json(const Summaries& summaries) {
  const auto layers = statistics::layers(summaries);
  auto bars = json::array();
  for (const auto& layer : layers.measured) {
    const auto& [total, added] = layer.round_trip_ns;
    if (!total) continue;
    bars.push_back({{"name", word(at(layer.run->run.asked, "id"))},
                    {"of", word(at(layer.run->run.asked, "transport"))},
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
    auto labels = labels_of(group);
    tell_apart(labels, group);
    for (std::size_t i = 0; i < group.size(); ++i) {
      const auto& summary = *group[i];
      const auto& asked = summary.run.asked;
      runs.push_back({{"run", summary.run.number},
                      {"ontime", is_said(at(asked, "ontime")) ? word(at(asked, "ontime")) : ""},
                      {"id", word(at(asked, "id"))},
                      {"label", labels[i]},
                      {"transport", word(at(asked, "transport"))},
                      {"payload_bytes", count(at(asked, "payload_bytes"))},
                      {"deadline_ns", ns_of(at(asked, "deadline_us"))},
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

}  // namespace ontime::report

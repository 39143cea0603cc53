// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include <fmt/format.h>

#include "gate/gate.hpp"
#include "report/conditions.hpp"
#include "report/runs.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

using statistics::Cost;
using statistics::Estimate;
using statistics::Layer;
using statistics::Layers;

constexpr double bar_width = 24;

std::string microseconds_of(double ns) { return fmt::format("{:.1f}", ns / 1e3); }
std::string in_whole(double count) { return fmt::format("{:.0f}", count); }

using Form = std::string (*)(double);

// The confidences of a page's intervals. If they differ, each interval shows its own.
using Confidence = std::pair<double, std::size_t>;  // and of how many repetitions
std::set<Confidence> confidences_of(const Layers& layers) {
  std::set<Confidence> all;
  for (const auto& layer : layers.measured)
    for (const auto* cost : {&layer.round_trip_ns, &layer.cpu_ns, &layer.instructions})
      if (const auto& added = cost->added; added && added->count > 1)
        all.insert({added->confidence, added->count});
  return all;
}

std::string percent_of(double share) { return fmt::format("{:.3g} %", share * 100); }

std::string median(const std::optional<Estimate>& estimate, Form form) {
  return estimate ? form(estimate->median) : nothing;
}

std::string with_interval(const std::optional<Estimate>& estimate, Form form, bool with_confidence) {
  if (!estimate) return nothing;
  auto text = (estimate->median < 0 ? "" : "+") + form(estimate->median);
  if (estimate->count < 2) return text;
  text += fmt::format(" [{}, {}]", form(estimate->low), form(estimate->high));
  return with_confidence ? text + " " + percent_of(estimate->confidence) : text;
}

// The layer's share of the round trip: blank for its baseline, filled for what the layer adds.
std::string bar(const Layer& layer, double longest_ns) {
  if (!layer.round_trip_ns.total || longest_ns <= 0) return "";
  const auto cells = [&](double ns) {
    return static_cast<int>(std::lround(std::max(0.0, ns) / longest_ns * bar_width));
  };
  const double total_ns = layer.round_trip_ns.total->median;
  const double added_ns = layer.round_trip_ns.added ? layer.round_trip_ns.added->median : total_ns;
  const int end = cells(total_ns), begin = std::min(end, cells(total_ns - added_ns));
  std::string text(static_cast<std::size_t>(begin), ' ');
  for (int cell = begin; cell < std::max(end, begin + 1); ++cell) text += "█";
  return text;
}

// A layer's name is its id; if several layers have the same id, also what tells them apart.
std::map<const Summary*, std::string> names_of(const Layers& layers) {
  std::map<std::string, Group> groups;
  for (const auto& layer : layers.measured) groups[word(layer.run->run.asked.id)].push_back(layer.run);
  std::map<const Summary*, std::string> names;
  for (const auto& [id, group] : groups) {
    auto labels = labels_without_repetition(group);
    tell_apart(labels, group);
    for (std::size_t i = 0; i < group.size(); ++i)
      names[group[i]] = shortened(id, gate::longest_id) + (group.size() == 1 ? "" : ": " + labels[i]);
  }
  return names;
}

std::vector<std::string> missing(const Layers& layers) {
  std::vector<std::pair<std::string, std::vector<std::string>>> by_reason;
  for (const auto& [id, reason] : layers.missing)
    entry_of(by_reason, reason).push_back(shortened(word(id), gate::longest_id));
  return texts_of(by_reason, [](const auto& one) {
    const auto& [reason, ids] = one;
    return "Not measured: " + join(ids, ", ") + (reason.empty() ? "" : ": " + word(reason));
  });
}

std::string instructions_note(const Layers& layers) {
  const bool asked = std::ranges::any_of(
      layers.measured, [](const Layer& layer) { return layer.run->run.asked.task.count_instructions; });
  return std::string("Instructions were not counted. Needed: ") + (asked ? "" : "count-instructions: on, ") +
         "a CPU counter (most virtual machines hide it) and permission (kernel.perf_event_paranoid).";
}

std::string legend_of(const std::set<Confidence>& confidences) {
  const std::string legend =
      "p50: median round trip. CPU: time of all threads on both ends per message. Both: median over the "
      "repetitions. Added: median of the differences from the baseline, repetition by repetition. ";
  if (confidences.empty()) return legend + "No intervals: no run was repeated together with its baseline.";
  if (confidences.size() > 1)
    return legend + "[low, high] C %: C % confidence interval of the median difference.";
  const auto [confidence, count] = *confidences.begin();
  return legend + fmt::format("[low, high]: {} confidence interval of the median difference, {} repetitions.",
                              percent_of(confidence), count);
}

ordered_json json_of(const std::optional<Estimate>& estimate) {
  if (!estimate) return nullptr;
  return {{"median", estimate->median},
          {"low", estimate->low},
          {"high", estimate->high},
          {"confidence", estimate->confidence},
          {"repetitions", estimate->count}};
}
ordered_json json_of(const Cost& cost) {
  return {{"total", json_of(cost.total)}, {"added", json_of(cost.added)}};
}

}  // namespace

Page layers_page_of(const Summaries& summaries) {
  using enum Column::Align;
  const auto layers = statistics::layers(summaries);
  Page page;
  page.notes = missing(layers);
  if (layers.measured.empty()) {
    if (page.notes.empty())
      page.notes.emplace_back(
          "No run names its baseline (key baseline in the scenario; see scenarios/layers.yaml).");
    return page;
  }
  double longest_ns = 0;
  bool counted = false;
  for (const auto& layer : layers.measured) {
    if (layer.round_trip_ns.total) longest_ns = std::max(longest_ns, layer.round_trip_ns.total->median);
    counted = counted || layer.instructions.total;
  }
  const auto confidences = confidences_of(layers);
  const bool each = confidences.size() > 1;
  const auto names = names_of(layers);
  Table table{.title = "What each layer costs a message",
              .columns = {{"Layer", left},
                          {"baseline", left},
                          {"p50\n(µs)"},
                          {"added (µs)"},
                          {"", left, true, 1},
                          {"CPU\n(µs)", right, false, 5},
                          {"CPU\nadded (µs)", right, false, 4}}};
  if (counted)
    table.columns.insert(table.columns.end(),
                         {{"Instructions", right, false, 3}, {"Instructions\nadded", right, false, 2}});
  for (const auto& layer : layers.measured) {
    const auto& name = names.at(layer.run);
    table.rows.push_back({name,
                          layer.base != nullptr   ? names.at(layer.base)
                          : layer.adds_to.empty() ? nothing
                                                  : word(layer.adds_to),
                          median(layer.round_trip_ns.total, microseconds_of),
                          with_interval(layer.round_trip_ns.added, microseconds_of, each),
                          bar(layer, longest_ns), median(layer.cpu_ns.total, microseconds_of),
                          with_interval(layer.cpu_ns.added, microseconds_of, each)});
    if (counted)
      table.rows.back().insert(table.rows.back().end(),
                               {median(layer.instructions.total, in_whole),
                                with_interval(layer.instructions.added, in_whole, each)});
    if (!layer.no_base.empty()) table.notes.push_back(name + ": no baseline: " + layer.no_base);
  }
  if (!counted) table.notes.push_back(instructions_note(layers));
  page.tables.push_back(table);
  page.legend = legend_of(confidences);
  return page;
}

ordered_json layers_json_of(const Summaries& summaries) {
  const auto layers = statistics::layers(summaries);
  auto result = ordered_json::array();
  for (const auto& layer : layers.measured) {
    const auto& asked = layer.run->run.asked;
    ordered_json entry = {{"id", asked.stated("id")}, {"transport", asked.stated("transport")}};
    entry["baseline"] = layer.adds_to;
    entry["adds_to"] = layer.adds_to;  // the earlier name, kept for one version
    entry["key"] = layer.run->run.key;
    entry["base_key"] = layer.base == nullptr ? ordered_json() : ordered_json(layer.base->run.key);
    for (const auto* key :
         {"payload_bytes", "receive", "options", "component_transport", "component_options"})
      entry[key] = asked.stated(key);
    entry["round_trip_ns"] = json_of(layer.round_trip_ns);
    entry["cpu_ns"] = json_of(layer.cpu_ns);
    entry["instructions"] = json_of(layer.instructions);
    entry["missing"] = or_null(layer.no_base);
    result.push_back(entry);
  }
  for (const auto& [id, reason] : layers.missing)
    result.push_back({{"id", id}, {"missing", reason.empty() ? "not measured" : reason}});
  return result;
}

std::string layers_csv_of(const Summaries& summaries) {
  const std::vector<std::string> texts = {"id",       "transport",     "adds_to", "key",
                                          "base_key", "payload_bytes", "receive"};
  const std::vector<std::string> costs = {"round_trip_ns", "cpu_ns", "instructions"};
  const std::vector<std::string> values = {"median", "low", "high", "confidence", "repetitions"};
  auto header = texts;
  for (const auto& cost : costs)
    for (const auto* part : {"total", "added"})
      for (const auto& value : values) header.push_back(fmt::format("{}_{}_{}", cost, part, value));
  const std::vector<std::string> further = {"baseline", "component_transport"};
  header.insert(header.end(), further.begin(), further.end());
  std::vector<std::vector<std::string>> rows;
  for (const auto& layer : layers_json_of(summaries)) {
    if (!layer.contains("key")) continue;
    auto& row = rows.emplace_back();
    for (const auto& key : texts) row.push_back(cell_at(layer, {key}));
    for (const auto& cost : costs)
      for (const auto* part : {"total", "added"})
        for (const auto& value : values) row.push_back(cell_at(layer, {cost, part, value}));
    for (const auto& key : further) row.push_back(cell_at(layer, {key}));
  }
  return as_csv(header, rows);
}

}  // namespace ontime::report

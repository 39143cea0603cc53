// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include <fmt/format.h>

#include "report/runs.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

using nlohmann::ordered_json;
using statistics::Cost;
using statistics::Estimate;
using statistics::Layer;

constexpr double bar_width = 24;

std::string microseconds_of(double ns) { return fmt::format("{:.1f}", ns / 1e3); }
std::string whole(double count) { return fmt::format("{:.0f}", count); }

using Form = std::string (*)(double);

std::string median(const std::optional<Estimate>& estimate, Form form) {
  return estimate ? form(estimate->median) : nothing;
}

std::string with_interval(const std::optional<Estimate>& estimate, Form form) {
  if (!estimate) return nothing;
  return fmt::format("{}{} [{}, {}]", estimate->median < 0 ? "" : "+", form(estimate->median),
                     form(estimate->low), form(estimate->high));
}

// Where the layer's share of the round trip lies: blank below what it adds to, filled for what it adds.
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

std::string confidence(const std::vector<Layer>& layers) {
  for (const auto& layer : layers)
    if (const auto& added = layer.round_trip_ns.added)
      return fmt::format(
          "In brackets the interval that holds the median difference with {:.1f} % confidence, of {} "
          "interleaved repetitions.",
          added->confidence * 100, added->count);
  return "No run was made twice or more beside the one it adds to: there are no intervals.";
}

}  // namespace

Page layers_page_of(const Summaries& summaries) {
  using enum Column::Align;
  const auto layers = statistics::layers(summaries);
  Page page;
  if (layers.empty()) {
    page.notes.emplace_back(
        "No run says what it adds to (key adds-to in the scenario; see scenarios/layers.yaml).");
    return page;
  }
  double longest_ns = 0;
  bool counted = false;
  for (const auto& layer : layers) {
    if (layer.round_trip_ns.total) longest_ns = std::max(longest_ns, layer.round_trip_ns.total->median);
    counted = counted || layer.instructions.total;
  }
  Table table{"What each layer costs a message",
              "",
              {{"Layer", left},
               {"adds to", left},
               {"p50\n(µs)", right},
               {"added (µs)", right},
               {"", left},
               {"CPU\n(µs)", right},
               {"added (µs)", right},
               {"Instructions", right},
               {"added", right}},
              {},
              {}};
  for (const auto& layer : layers)
    table.rows.push_back(
        {layer.id, layer.adds_to.empty() ? nothing : layer.adds_to,
         median(layer.round_trip_ns.total, microseconds_of),
         with_interval(layer.round_trip_ns.added, microseconds_of), bar(layer, longest_ns),
         median(layer.cpu_ns.total, microseconds_of), with_interval(layer.cpu_ns.added, microseconds_of),
         median(layer.instructions.total, whole), with_interval(layer.instructions.added, whole)});
  if (!counted)
    table.notes.emplace_back(
        "Instructions: not counted. The scenario must say count-instructions: on, and the CPU must "
        "have the counter, which most virtual machines hide; kernel.perf_event_paranoid must let us.");
  page.tables.push_back(table);
  page.legend = "p50: round trip of the median message. CPU: time of all threads on both ends, a message. " +
                confidence(layers);
  return page;
}

ordered_json layers_json_of(const Summaries& summaries) {
  auto result = ordered_json::array();
  for (const auto& layer : statistics::layers(summaries))
    result.push_back({{"id", layer.id},
                      {"transport", layer.transport},
                      {"adds_to", layer.adds_to},
                      {"round_trip_ns", json_of(layer.round_trip_ns)},
                      {"cpu_ns", json_of(layer.cpu_ns)},
                      {"instructions", json_of(layer.instructions)}});
  return result;
}

}  // namespace ontime::report

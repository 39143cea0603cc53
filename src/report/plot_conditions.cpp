// SPDX-License-Identifier: Apache-2.0
// One row for each condition: p50, p99, p99.9 and max, and between what they lie: repetitions from the lowest
// to the highest, a single run's 95 % confidence interval.
#include <algorithm>
#include <array>

#include <fmt/format.h>

#include "report/plots.hpp"

namespace ontime::report {
namespace {

using statistics::Certainty;
using statistics::Distribution;
using statistics::Measured;
using statistics::Summary;

struct Metric {
  const char* name;
  std::int64_t Distribution::*of;
  Measured Certainty::*sure;  // the greatest has none
  const char* point;
};
constexpr std::array metrics = {
    Metric{"p50", &Distribution::p50, &Certainty::p50, "pointtype 7 pointsize 0.5 linecolor rgb '#0072b2'"},
    Metric{"p99", &Distribution::p99, &Certainty::p99, "pointtype 9 pointsize 0.55 linecolor rgb '#009e73'"},
    Metric{"p99.9", &Distribution::p99_9, &Certainty::p99_9,
           "pointtype 5 pointsize 0.45 linecolor rgb '#882255'"},
    Metric{"max", &Distribution::max, nullptr,
           "pointtype 2 pointsize 0.45 linewidth 1 linecolor rgb '#000000'"}};
constexpr const char* bar_colours[] = {"#b00072b2", "#b0009e73", "#b0882255", "#b0000000"};

struct Found {
  double median_ms, low_ms, high_ms;
};
// Of those runs in which something was answered.
std::optional<Found> found_in(const Group& runs, const Metric& metric, double edge_ms) {
  std::vector<double> values;
  const Summary* last = nullptr;
  for (const auto* run : runs)
    if (run->round_trip.count > 0) {
      values.push_back(ms(run->round_trip.*metric.of));
      last = run;
    }
  if (values.empty()) return {};
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  Found found{statistics::estimate(values)->median, *low, *high};
  if (values.size() == 1 && metric.sure != nullptr) {
    const auto& sure = (last->round_trip_certainty.*metric.sure).sure;
    if (sure.low) found.low_ms = ms(*sure.low);
    found.high_ms = sure.high ? ms(*sure.high) : edge_ms;
  }
  return found;
}

}  // namespace

std::string plot_conditions(const Group& group, const Plot& plot) {
  constexpr double left_cm = 0.3, right_cm = 0.45, strip_cm = 0.5, gap_cm = 0.12, bottom_cm = 0.95;
  const auto width = Sheet::width_cm(plot), inner_cm = width - left_cm - right_cm;
  const auto conditions = conditions_of(group);
  const auto range = range_of(group);

  std::vector<std::vector<std::string>> titles;
  double rows_cm = 0;
  for (const auto& [name, label, runs] : conditions) {
    const auto counts =
        text_of(counts_of(runs)) + (runs.size() > 1 ? fmt::format(" in {} runs", runs.size()) : "");
    auto& title = titles.emplace_back(wrapped(name, inner_cm));
    title.push_back(counts);
    rows_cm += static_cast<double>(title.size()) * line_cm + strip_cm + gap_cm;
  }
  std::vector<Entry> entries;
  for (std::size_t i = 0; i < metrics.size(); ++i)
    entries.push_back(
        {metrics[i].name,
         metrics[i].sure == nullptr ? "" : fmt::format("linewidth 5 linecolor rgb '{}'", bar_colours[i]),
         metrics[i].point});
  const auto deadlines = deadlines_ms(group);
  if (!deadlines.empty()) entries.push_back({deadline_text(deadlines), deadline_style, ""});
  const bool any_repeated =
      std::any_of(conditions.begin(), conditions.end(), [](const auto& one) { return one.runs.size() > 1; });
  const bool any_single =
      std::any_of(conditions.begin(), conditions.end(), [](const auto& one) { return one.runs.size() == 1; });
  if (any_repeated) entries.push_back({"bar: lowest to highest repetition; sign: their median", "", ""});
  if (any_single)
    entries.push_back(
        {any_repeated ? "of a single run: 95 % confidence interval" : "bar: 95 % confidence interval", "",
         ""});
  const Legend legend(entries, inner_cm);

  const double top_cm = 0.1, axes_bottom = top_cm + rows_cm;
  Sheet sheet(plot, axes_bottom + bottom_cm + legend.height_cm() + 0.15);
  const Box axes{left_cm, top_cm, width - right_cm, axes_bottom};
  sheet.add(fmt::format(
      "set border 1\nunset ytics\nset grid noytics xtics linetype 1 linewidth 0.4 linecolor rgb '#dddddd'\n"
      "set logscale x\nset xrange [{}:{}]\nset yrange [{}:0]",
      range.least_ms, range.greatest_ms, rows_cm));
  sheet.add(time_tics("x", range.least_ms, range.greatest_ms));
  sheet.text((axes.left + axes.right) / 2, axes_bottom + 0.7, "Round trip", "center");
  legend.draw(sheet, left_cm, axes_bottom + bottom_cm);

  std::array<std::string, metrics.size()> points, bars;
  std::string deadline_lines, extents;
  double row_cm = 0;
  for (std::size_t i = 0; i < conditions.size(); ++i) {
    const auto& runs = conditions[i].runs;
    for (std::size_t line = 0; line < titles[i].size(); ++line, row_cm += line_cm)
      sheet.text(left_cm, top_cm + row_cm + line_cm / 2, titles[i][line],
                 line + 1 == titles[i].size() ? "left textcolor rgb '#555555'" : "left");
    const auto middle = row_cm + strip_cm / 2;
    for (std::size_t m = 0; m < metrics.size(); ++m)
      if (const auto found = found_in(runs, metrics[m], range.greatest_ms)) {
        points[m] += fmt::format("{:.6g} {:.4f}\n", found->median_ms, middle);
        bars[m] += fmt::format("{0:.6g} {1:.4f}\n{2:.6g} {1:.4f}\n\n", found->low_ms, middle,
                               std::max(found->high_ms, found->low_ms * 1.003));
      }
    double least = 1e12, greatest = 0;
    for (const auto* run : runs)
      if (run->round_trip.count > 0) {
        least = std::min(least, ms(run->round_trip.min));
        greatest = std::max(greatest, ms(run->round_trip.max));
      }
    if (greatest > 0) extents += fmt::format("{0:.6g} {1:.4f}\n{2:.6g} {1:.4f}\n\n", least, middle, greatest);
    for (const auto deadline : deadlines_ms(runs))
      deadline_lines +=
          fmt::format("{0:.6g} {1:.4f}\n{0:.6g} {2:.4f}\n\n", deadline, row_cm, row_cm + strip_cm);
    row_cm += strip_cm + gap_cm;
  }
  std::vector<std::string> parts;
  const auto add = [&](const std::string& name, const std::string& lines, const std::string& with) {
    if (lines.empty()) return;
    sheet.data(name, lines);
    parts.push_back(fmt::format("${} {}", name, with));
  };
  add("extents", extents, "with lines linewidth 0.7 linecolor rgb '#888888'");
  add("deadlines", deadline_lines, fmt::format("with lines {}", deadline_style));
  for (std::size_t m = 0; m < metrics.size(); ++m)
    add(fmt::format("bars{}", m), bars[m],
        fmt::format("with lines linewidth 5 linecolor rgb '{}'", bar_colours[m]));
  for (std::size_t m = 0; m < metrics.size(); ++m)
    add(fmt::format("points{}", m), points[m], fmt::format("with points {}", metrics[m].point));
  if (parts.empty()) parts.emplace_back("NaN");
  sheet.plot(axes, parts);
  return sheet.commands();
}

}  // namespace ontime::report

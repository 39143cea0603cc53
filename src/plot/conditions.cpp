// SPDX-License-Identifier: Apache-2.0
// One row for each condition: p50, p99, p99.9 and max, and between what they lie: repetitions from the lowest
// to the highest, a single run's 95 % confidence interval. A run that supports no interval has no bar.
#include <algorithm>
#include <array>

#include <fmt/format.h>

#include "plot/figures.hpp"
#include "report/answer.hpp"
#include "report/words.hpp"

namespace ontime::plot {
namespace {

struct Drawn {
  Figure figure;
  const char* point;
  bool has_interval() const { return figure != Figure::max; }
};
constexpr std::array metrics = {
    Drawn{Figure::p50, "pointtype 7 pointsize 0.5 linecolor rgb '#0072b2'"},
    Drawn{Figure::p99, "pointtype 9 pointsize 0.55 linecolor rgb '#009e73'"},
    Drawn{Figure::p99_9, "pointtype 5 pointsize 0.45 linecolor rgb '#882255'"},
    Drawn{Figure::max, "pointtype 2 pointsize 0.45 linewidth 1 linecolor rgb '#000000'"}};
constexpr const char* whole_style = "linewidth 0.7 linecolor rgb '#888888'";
constexpr const char* bar_colours[] = {"#b00072b2", "#b0009e73", "#b0882255", "#b0000000"};

struct Bar {
  double from_ms, to_ms;
};
struct Found {
  double median_ms;
  std::optional<Bar> bar;
};
std::optional<Found> found_in(const Group& runs, const Drawn& metric, const Range& range) {
  const auto spread = report::spread_of(runs, metric.figure);
  if (!spread) return {};
  Found found{range.at(spread->median_ns), {}};
  if (runs.size() > 1) {
    // Without a width it would be drawn as if the runs differed.
    if (spread->low_ns < spread->high_ns) found.bar = {range.at(spread->low_ns), range.at(spread->high_ns)};
  } else if (metric.has_interval()) {
    const auto& [low, high] = runs.front()->round_trip_certainty[metric.figure].sure;
    if (low) found.bar = {range.at(*low), high ? range.at(*high) : range.greatest_ms};
  }
  return found;
}

bool is_answered(const Group& runs) {
  return std::ranges::any_of(runs, [](const auto* run) { return run->round_trip.count > 0; });
}

std::vector<Entry> entries_of(const std::vector<Condition>& conditions, const Group& group) {
  const auto repeated = static_cast<std::size_t>(
      std::ranges::count_if(conditions, [](const auto& condition) { return condition.runs.size() > 1; }));
  std::vector<Entry> entries;
  std::vector<std::string> missing;
  for (std::size_t i = 0; i < metrics.size(); ++i) {
    const std::string name = statistics::metric_of(metrics[i].figure).name;
    bool is_drawn = false, has_bar = false;
    for (const auto& condition : conditions)
      if (const auto found = found_in(condition.runs, metrics[i], {})) {
        is_drawn = true;
        has_bar = has_bar || found->bar;
      } else if (is_answered(condition.runs)) {
        add_once(missing, name);
      }
    if (!is_drawn) continue;
    entries.push_back({name, has_bar ? fmt::format("linewidth 5 linecolor rgb '{}'", bar_colours[i]) : "",
                       metrics[i].point});
  }
  if (is_answered(group)) entries.push_back({"from the fastest to the slowest", whole_style});
  if (const auto deadlines = deadlines_ms(group); !deadlines.empty())
    entries.push_back({deadline_text(deadlines), deadline_style});
  if (!missing.empty())
    entries.push_back({fmt::format("no {}: too few {} in a run", join(missing, ", "),
                                   report::all_listened(group) ? "messages" : "answers")});
  if (repeated > 0) entries.push_back({"bar: lowest to highest repetition; sign: their median"});
  if (repeated < conditions.size())
    entries.push_back(
        {fmt::format("{}: 95 % confidence interval; to the edge: no upper limit; no bar: no interval",
                     repeated > 0 ? "of a single run" : "bar")});
  return entries;
}

std::string horizontal(double from_ms, double to_ms, double y) {
  return fmt::format("{0:.6g} {2:.4f}\n{1:.6g} {2:.4f}\n\n", from_ms, std::max(to_ms, from_ms * 1.003), y);
}

// What there is to draw of all rows, each at its height.
struct Lines {
  void add(const Group& runs, double top, double bottom, const Range& range) {
    const auto middle = (top + bottom) / 2;
    for (std::size_t m = 0; m < metrics.size(); ++m)
      if (const auto found = found_in(runs, metrics[m], range)) {
        points[m] += fmt::format("{:.6g} {:.4f}\n", found->median_ms, middle);
        if (found->bar) bars[m] += horizontal(found->bar->from_ms, found->bar->to_ms, middle);
      }
    double least = 1e12, greatest = 0;
    for (const auto* run : runs)
      if (run->round_trip.count > 0) {
        least = std::min(least, range.at(run->round_trip.min));
        greatest = std::max(greatest, range.at(run->round_trip.max));
      }
    if (greatest > 0) extents += horizontal(least, greatest, middle);
    for (const auto deadline : deadlines_ms(runs))
      deadlines += fmt::format("{0:.6g} {1:.4f}\n{0:.6g} {2:.4f}\n\n", deadline, top, bottom);
  }
  void draw(Sheet& sheet) const {
    sheet.draw("extents", extents, fmt::format("with lines {}", whole_style));
    sheet.draw("deadlines", deadlines, fmt::format("with lines {}", deadline_style));
    for (std::size_t m = 0; m < metrics.size(); ++m)
      sheet.draw(fmt::format("bars{}", m), bars[m],
                 fmt::format("with lines linewidth 5 linecolor rgb '{}'", bar_colours[m]));
    for (std::size_t m = 0; m < metrics.size(); ++m)
      sheet.draw(fmt::format("points{}", m), points[m], fmt::format("with points {}", metrics[m].point));
  }

 private:
  std::array<std::string, metrics.size()> points, bars;
  std::string extents, deadlines;
};

}  // namespace

std::string plot_conditions(const Group& group, const Plot& plot) {
  constexpr double left_cm = 0.55, right_cm = 0.45, top_cm = 0.1, strip_cm = 0.5, gap_cm = 0.12,
                   bottom_cm = 0.95;
  const auto width = Sheet::width_cm(plot), inner_cm = width - left_cm - right_cm;
  const auto conditions = conditions_of(group);
  const auto range = range_of(group);
  const Legend legend(entries_of(conditions, group), inner_cm);

  std::vector<std::vector<Line>> titles;
  double rows_cm = 0;
  for (const auto& [name, label, runs] : conditions) {
    auto& title = titles.emplace_back();
    add_lines(title, name, inner_cm);
    add_lines(title,
              text_of(counts_of(runs)) + (runs.size() > 1 ? fmt::format(" in {} runs", runs.size()) : ""),
              inner_cm, grey_text);
    rows_cm += static_cast<double>(title.size()) * line_cm + strip_cm + gap_cm;
  }
  const Box axes{left_cm, top_cm, width - right_cm, top_cm + rows_cm};
  Sheet sheet(plot, axes.bottom + bottom_cm + legend.height_cm() + 0.15);
  sheet.add(fmt::format(
      "set border 1\nunset ytics\nset grid noytics xtics linetype 1 linewidth 0.4 linecolor rgb '#dddddd'\n"
      "set logscale x\nset xrange [{}:{}]\nset yrange [{}:0]",
      range.least_ms, range.greatest_ms, rows_cm));
  sheet.add(time_tics("x", range.least_ms, range.greatest_ms));
  sheet.text((axes.left + axes.right) / 2, axes.bottom + 0.7, report::quantity_of(group), "center");
  legend.draw(sheet, left_cm, axes.bottom + bottom_cm);
  Lines lines;
  double y = 0;
  for (std::size_t i = 0; i < conditions.size(); ++i) {
    for (const auto& [text, style] : titles[i]) {
      sheet.text(left_cm, top_cm + y + line_cm / 2, text, style);
      y += line_cm;
    }
    lines.add(conditions[i].runs, y, y + strip_cm, range);
    y += strip_cm + gap_cm;
  }
  lines.draw(sheet);
  sheet.plot(axes);
  return sheet.commands();
}

}  // namespace ontime::plot

// SPDX-License-Identifier: Apache-2.0
// Round trips over time, a panel for each run, all on the same axes.
#include <algorithm>
#include <cmath>
#include <utility>

#include <fmt/format.h>

#include "plot/figures.hpp"
#include "report/runs.hpp"
#include "report/words.hpp"

namespace ontime::plot {
namespace {

constexpr std::uint64_t few = 10;  // messages of a stretch: of these a median says no more than they do
constexpr const char* extent_style = "linewidth 0.9 linecolor rgb '#0072b2'";
constexpr const char* alone_style = "linewidth 1.7 linecolor rgb '#0072b2'";
constexpr const char* median_style = "linewidth 0.7 linecolor rgb '#000000'";
constexpr const char* late_style = "linewidth 2.4 linecolor rgb '#d55e00'";
constexpr const char* wait_style = "linewidth 2.4 linecolor rgb '#882255'";
constexpr const char* lost_style = "pointtype 2 pointsize 0.4 linewidth 0.8 linecolor rgb '#000000'";

// About a line's width: finer stretches look the same, and make a figure of megabytes.
constexpr double stretches_a_cm = 50;
using Stretch =
    std::pair<double, statistics::Slice>;  // at so many s; the median is that of its slices' medians
// As many slices together as it takes to be no more than so many. No extreme is left out.
std::vector<Stretch> stretches_of(const statistics::Shape& shape, std::size_t most) {
  const auto each = std::max<std::size_t>((shape.slices.size() + most - 1) / most, 1);
  std::vector<Stretch> stretches;
  for (std::size_t first = 0; first < shape.slices.size(); first += each) {
    const auto after = std::min(first + each, shape.slices.size());
    statistics::Slice all;
    std::vector<double> medians;
    for (auto i = first; i < after; ++i) {
      const auto& slice = shape.slices[i];
      all.sent += slice.sent;
      all.late += slice.late;
      all.lost += slice.lost;
      all.skipped_cycles += slice.skipped_cycles;
      all.skipped_wait_max_ns = std::max(all.skipped_wait_max_ns, slice.skipped_wait_max_ns);
      if (slice.sent == slice.lost) continue;
      all.min_ns = medians.empty() ? slice.min_ns : std::min(all.min_ns, slice.min_ns);
      all.max_ns = std::max(all.max_ns, slice.max_ns);
      medians.push_back(static_cast<double>(slice.p50_ns));
    }
    if (!medians.empty()) all.p50_ns = std::llround(statistics::estimate(medians)->median);
    if (all.sent > 0 || all.skipped_cycles > 0)
      stretches.push_back(
          {static_cast<double>(first + after) / 2 * static_cast<double>(shape.slice_ns) / 1e9, all});
  }
  return stretches;
}

// A line, or, where it has no length, a dot: gnuplot leaves out what has none.
std::string segment(double at, double from_ms, double to_ms) {
  return fmt::format("{0:.6g} {1:.6g}\n{0:.6g} {2:.6g}\n\n", at, from_ms, std::max(to_ms, from_ms * 1.003));
}

// Its name, and its length in s.
std::pair<const char*, double> unit_for(double end_s) {
  return end_s > 3 * 3600 ? std::pair{"h", 3600.0}
         : end_s > 600    ? std::pair{"min", 60.0}
                          : std::pair{"s", 1.0};
}

// From the fastest to the slowest message it is no longer than a dot: its line would be hard to see.
bool is_dot(const statistics::Slice& of, const Range& range) {
  constexpr double as_a_dot = 1.15;
  return range.at(of.max_ns) < range.at(of.min_ns) * as_a_dot;
}

bool has_medians(const Summary* run) {
  const auto slices = run->shape.slices.size();
  return slices > 0 && run->sent > few * slices;
}

void draw(Sheet& sheet, const Summary& summary, std::size_t run, const Range& range,
          const std::vector<Stretch>& stretches, double unit_s) {
  std::string extents, alone, medians, late, lost, passed;
  for (const auto& [at_s, of] : stretches) {
    const bool answered = of.sent > of.lost;
    const auto at = at_s / unit_s, min_ms = range.at(of.min_ns), max_ms = range.at(of.max_ns);
    if (answered) (is_dot(of, range) ? alone : extents) += segment(at, min_ms, max_ms);
    medians += answered ? fmt::format("{:.6g} {:.6g}\n", at, range.at(of.p50_ns)) : "\n";
    if (of.late > 0) late += segment(at, max_ms, max_ms);
    if (of.lost > 0) lost += fmt::format("{:.6g} 0.95\n", at);
    if (of.skipped_cycles > 0)
      passed += segment(at, range.at(of.skipped_wait_max_ns), range.at(of.skipped_wait_max_ns));
  }
  const auto add = [&](const char* name, const std::string& lines, const std::string& with) {
    sheet.draw(fmt::format("{}{}", name, run), lines, with);
  };
  if (const auto deadline = deadline_ms(summary))
    sheet.draw(fmt::format("{} with lines {}", *deadline, deadline_style));
  add("extents", extents, fmt::format("with lines {}", extent_style));
  add("alone", alone, fmt::format("with lines {}", alone_style));
  if (has_medians(&summary)) add("medians", medians, fmt::format("with lines {}", median_style));
  add("late", late, fmt::format("with lines {}", late_style));
  add("passed", passed, fmt::format("with lines {}", wait_style));
  add("lost", lost, fmt::format("axes x1y2 with points {}", lost_style));
}

// With schedule fixed, lateness counts from when a message was due, and its round trip from when it was sent.
bool has_late_below_the_deadline(const Group& group, const std::vector<std::vector<Stretch>>& stretches) {
  for (std::size_t i = 0; i < group.size(); ++i) {
    const auto& client = group[i]->run.asked.task.client;
    if (client.schedule == roundtrip::Schedule::fixed &&
        std::ranges::any_of(stretches[i], [&](const Stretch& one) {
          return one.second.late > 0 && one.second.max_ns <= client.deadline.count();
        }))
      return true;
  }
  return false;
}

std::vector<Entry> entries_of(const Group& group, const std::vector<std::vector<Stretch>>& stretches,
                              const Range& range) {
  const auto any = [&](auto is_it) {
    return std::ranges::any_of(stretches, [&](const auto& of_run) {
      return std::ranges::any_of(of_run, [&](const Stretch& one) { return is_it(one.second); });
    });
  };
  std::vector<Entry> entries;
  if (any([&](const auto& of) { return of.sent > of.lost && !is_dot(of, range); }))
    entries.push_back({"from the fastest to the slowest", extent_style});
  else if (any([](const auto& of) { return of.sent > of.lost; }))
    entries.push_back({"messages", "", "pointtype 7 pointsize 0.25 linecolor rgb '#0072b2'"});
  if (std::ranges::any_of(group, has_medians)) entries.push_back({"median", median_style});
  if (any([](const auto& of) { return of.late > 0; }))
    entries.push_back({has_late_below_the_deadline(group, stretches)
                           ? "late (fixed schedule: from when due, so also below the deadline)"
                           : "late",
                       "", "pointtype 7 pointsize 0.3 linecolor rgb '#d55e00'"});
  if (any([](const auto& of) { return of.lost > 0; }))
    entries.push_back({"lost (at the top)", "", lost_style});
  if (any([](const auto& of) { return of.skipped_cycles > 0; }))
    entries.push_back({"longest wait of cycles without a message", "",
                       "pointtype 7 pointsize 0.3 linecolor rgb '#882255'"});
  if (const auto deadlines = deadlines_ms(group); !deadlines.empty())
    entries.push_back({deadline_text(deadlines), deadline_style});
  return entries;
}

// "Not drawn: 2 messages due after 3.2 h". Else empty.
std::string beyond_text(const Summary& summary) {
  const auto& beyond = summary.shape.beyond;
  if (beyond.empty()) return "";
  const auto first_s = seconds_into(summary, std::ranges::min(beyond, {}, &roundtrip::Sample::due_ns).due_ns);
  const auto [unit, unit_s] = unit_for(first_s);
  const auto first = first_s / unit_s;
  return fmt::format("Not drawn: {} due after {} {}", many(beyond.size(), "message", "messages"),
                     first < 99.5 ? fmt::format("{:.2g}", first) : fmt::format("{:.0f}", first), unit);
}

// Its slices went with the samples.
constexpr const char* worst_only =
    "Not drawn: only the worst messages were kept. For this figure keep all: listen --results without "
    "--keep.";

constexpr double left_cm = 1.65, right_cm = 0.3, between_cm = 0.25, bottom_cm = 0.95, most_cm = 23;

std::size_t columns_for(const Group& group, const Plot& plot) {
  return plot.wide && group.size() > 1 ? 2 : 1;
}
// Of the axes of a panel.
double inner_cm_of(const Group& group, const Plot& plot) {
  return Sheet::width_cm(plot) / static_cast<double>(columns_for(group, plot)) - left_cm - right_cm;
}

// Where the panels are: column by column, as high as a page allows.
struct Layout {
  Layout(const Group& group, const Plot& plot, double legend_cm)
      : columns(columns_for(group, plot)),
        rows((group.size() + columns - 1) / columns),
        column_cm(Sheet::width_cm(plot) / static_cast<double>(columns)),
        tops(rows, 0),
        lines(rows, 0) {
    const auto names = names_of(group);
    const auto inner_cm = inner_cm_of(group, plot);
    for (std::size_t i = 0; i < group.size(); ++i) {
      auto& title = titles.emplace_back();
      add_lines(title, names[i], inner_cm);
      if (group[i]->has_worst_only) add_lines(title, worst_only, inner_cm);
      if (const auto text = beyond_text(*group[i]); !text.empty()) add_lines(title, text, inner_cm);
      add_lines(title, text_of(counts_of({group[i]})), inner_cm, grey_text);
      lines[i % rows] = std::max(lines[i % rows], title.size());
    }
    auto others_cm = bottom_cm + legend_cm + 0.2;
    for (const auto of_row : lines) others_cm += static_cast<double>(of_row) * line_cm + between_cm;
    axes_cm = rows == 1 ? 3.6 : std::clamp((most_cm - others_cm) / static_cast<double>(rows), 0.9, 2.2);
    height_cm = others_cm + axes_cm * static_cast<double>(rows);
    double top = 0.1;
    for (std::size_t row = 0; row < rows; ++row) {
      tops[row] = top;
      top += static_cast<double>(lines[row]) * line_cm + axes_cm + between_cm;
    }
  }
  double left_of(std::size_t panel) const {
    const auto column = panel / rows;
    return static_cast<double>(column) * column_cm;
  }
  Box axes_of(std::size_t panel) const {
    const auto top = tops[panel % rows] + static_cast<double>(lines[panel % rows]) * line_cm;
    return {left_of(panel) + left_cm, top, left_of(panel) + column_cm - right_cm, top + axes_cm};
  }
  bool is_lowest(std::size_t panel) const { return (panel + 1) % rows == 0 || panel + 1 == titles.size(); }

  std::size_t columns, rows;
  double column_cm, axes_cm = 0, height_cm = 0;
  std::vector<std::vector<Line>> titles;
  std::vector<double> tops;        // of each row
  std::vector<std::size_t> lines;  // of the longest title of each row
};

double end_of(const Group& group) {
  double end_s = 0;
  for (const auto* run : group)
    end_s = std::max(end_s, static_cast<double>(run->shape.slices.size()) *
                                static_cast<double>(run->shape.slice_ns) / 1e9);
  if (end_s <= 0) end_s = 1;             // nothing is drawn
  return std::max(end_s, 1e-6) * 1.005;  // so that a whole number at the end has its tick
}

// Titles stand right above the axes, whatever the longest one of the row takes.
void add_texts(Sheet& sheet, const Layout& layout, std::size_t panel, const char* unit) {
  const auto axes = layout.axes_of(panel);
  const auto& title = layout.titles[panel];
  auto y = axes.top - (static_cast<double>(title.size()) - 0.5) * line_cm;
  for (const auto& [text, style] : title) {
    sheet.text(axes.left, y, text, style);
    y += line_cm;
  }
  if (layout.is_lowest(panel))
    sheet.text((axes.left + axes.right) / 2, axes.bottom + 0.7, fmt::format("Time ({})", unit), "center");
}

// Once beside a column of panels, which are too low for it; where they differ, beside each.
void add_quantities(Sheet& sheet, const Layout& layout, const Group& group) {
  const auto common = report::quantity_of(group);
  for (std::size_t first = 0; first < group.size();) {
    const auto quantity = report::quantity_of(Group{group[first]});
    auto last = first;
    if (quantity == common)
      while (!layout.is_lowest(last)) ++last;
    sheet.text(layout.left_of(first) + 0.2, (layout.axes_of(first).top + layout.axes_of(last).bottom) / 2,
               quantity, "center rotate");
    first = last + 1;
  }
}

}  // namespace

std::string plot_over_time(const Group& group, const Plot& plot) {
  auto range = range_of(group);
  const auto most_stretches = static_cast<std::size_t>(inner_cm_of(group, plot) * stretches_a_cm);
  std::vector<std::vector<Stretch>> stretches;
  for (const auto* run : group) stretches.push_back(stretches_of(run->shape, most_stretches));
  const Legend legend(entries_of(group, stretches, range), Sheet::width_cm(plot) - left_cm - right_cm);
  const Layout layout(group, plot, legend.height_cm());
  const auto end_s = end_of(group);
  const auto [unit, unit_s] = unit_for(end_s);
  if (counts_of(group).lost > 0)  // room for them above all that was answered
    range.greatest_ms *= std::pow(range.greatest_ms / range.least_ms, 0.12);

  Sheet sheet(plot, layout.height_cm);
  sheet.add(fmt::format("set logscale y\nset yrange [{}:{}]\nset y2range [0:1]\nset xrange [0:{}]",
                        range.least_ms, range.greatest_ms, end_s / unit_s));
  sheet.add(time_tics("y", range.least_ms, range.greatest_ms));
  legend.draw(sheet, left_cm, layout.height_cm - legend.height_cm() - 0.1);
  add_quantities(sheet, layout, group);
  for (std::size_t i = 0; i < group.size(); ++i) {
    add_texts(sheet, layout, i, unit);
    sheet.add(layout.is_lowest(i) ? "set format x '%g'" : "set format x ''");
    draw(sheet, *group[i], i, range, stretches[i], unit_s);
    sheet.plot(layout.axes_of(i));
  }
  return sheet.commands();
}

}  // namespace ontime::plot

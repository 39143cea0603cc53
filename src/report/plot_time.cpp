// SPDX-License-Identifier: Apache-2.0
// Round trips over time, a panel for each run, all on the same axes.
#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "report/plots.hpp"
#include "report/runs.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

using statistics::Summary;

constexpr std::uint64_t few = 10;  // messages of a stretch: of these a median says no more than they do
constexpr const char* extent_style = "linewidth 0.9 linecolor rgb '#0072b2'";
constexpr const char* alone_style = "linewidth 1.7 linecolor rgb '#0072b2'";
constexpr const char* median_style = "linewidth 0.7 linecolor rgb '#000000'";
constexpr const char* late_style = "linewidth 2.4 linecolor rgb '#d55e00'";
constexpr const char* wait_style = "linewidth 2.4 linecolor rgb '#882255'";
constexpr const char* lost_style = "pointtype 2 pointsize 0.4 linewidth 0.8 linecolor rgb '#000000'";

// As long as a line is wide: finer ones cannot be told apart, and make a figure of megabytes.
constexpr double stretches_a_cm = 50;
struct Stretch {
  double at_s;
  statistics::Slice of;  // its median is that of its slices' medians
};
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
      all.response_max_ns = std::max(all.response_max_ns, slice.response_max_ns);
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
std::string segment(double at, std::int64_t from_ns, std::int64_t to_ns) {
  const auto to_ms = std::max(ms(to_ns), ms(from_ns) * 1.003);
  return fmt::format("{0:.6g} {1:.6g}\n{0:.6g} {2:.6g}\n\n", at, ms(from_ns), to_ms);
}

struct TimeUnit {
  const char* name;
  double seconds;
};
TimeUnit unit_for(double end_s) {
  return end_s > 3 * 3600 ? TimeUnit{"h", 3600} : end_s > 600 ? TimeUnit{"min", 60} : TimeUnit{"s", 1};
}

// Of a run what there is to draw, as gnuplot's parts of a plot.
std::vector<std::string> parts_of(Sheet& sheet, const Summary& summary, std::size_t run,
                                  std::size_t most_stretches, double unit_s) {
  constexpr double as_a_dot = 1.15;  // so much longer than short: its line would be hard to see
  std::string extents, alone, medians, late, lost, passed;
  for (const auto& [at_s, of] : stretches_of(summary.shape, most_stretches)) {
    const bool answered = of.sent > of.lost;
    const auto at = at_s / unit_s;
    if (answered)
      (ms(of.max_ns) < ms(of.min_ns) * as_a_dot ? alone : extents) += segment(at, of.min_ns, of.max_ns);
    medians += answered ? fmt::format("{:.6g} {:.6g}\n", at, ms(of.p50_ns)) : "\n";
    if (of.late > 0) late += segment(at, of.max_ns, of.max_ns);
    if (of.lost > 0) lost += fmt::format("{:.6g} 0.95\n", at);
    if (of.skipped_cycles > 0) passed += segment(at, of.response_max_ns, of.response_max_ns);
  }
  std::vector<std::string> parts;
  const auto add = [&](const char* name, const std::string& lines, const std::string& with) {
    if (lines.empty()) return;
    sheet.data(fmt::format("{}{}", name, run), lines);
    parts.push_back(fmt::format("${}{} {}", name, run, with));
  };
  if (const auto deadline = deadline_ms(summary))
    parts.push_back(fmt::format("{} with lines {}", *deadline, deadline_style));
  add("extents", extents, fmt::format("with lines {}", extent_style));
  add("alone", alone, fmt::format("with lines {}", alone_style));
  if (summary.sent > few * summary.shape.slices.size())
    add("medians", medians, fmt::format("with lines {}", median_style));
  add("late", late, fmt::format("with lines {}", late_style));
  add("passed", passed, fmt::format("with lines {}", wait_style));
  add("lost", lost, fmt::format("axes x1y2 with points {}", lost_style));
  return parts;
}

std::vector<Entry> entries_of(const Group& group) {
  const auto counts = counts_of(group);
  std::vector<Entry> entries{{"from the fastest to the slowest", extent_style, ""}};
  if (std::any_of(group.begin(), group.end(),
                  [](const auto* run) { return run->sent > few * run->shape.slices.size(); }))
    entries.push_back({"median", median_style, ""});
  if (counts.late > 0) entries.push_back({"late", "", "pointtype 7 pointsize 0.3 linecolor rgb '#d55e00'"});
  if (counts.lost > 0) entries.push_back({"lost (at the top)", "", lost_style});
  if (counts.skipped_cycles > 0)
    entries.push_back({"longest wait of cycles without a message", "",
                       "pointtype 7 pointsize 0.3 linecolor rgb '#882255'"});
  if (const auto deadlines = deadlines_ms(group); !deadlines.empty())
    entries.push_back({deadline_text(deadlines), deadline_style, ""});
  return entries;
}

}  // namespace

std::string plot_over_time(const Group& group, const Plot& plot) {
  constexpr double left_cm = 1.45, right_cm = 0.3, between_cm = 0.25, bottom_cm = 0.95, sheet_cm = 23;
  const auto width = Sheet::width_cm(plot);
  const std::size_t columns = plot.wide && group.size() > 1 ? 2 : 1;
  const auto rows = (group.size() + columns - 1) / columns;
  const auto column_cm = width / static_cast<double>(columns), inner_cm = column_cm - left_cm - right_cm;

  const auto names = names_of(group);
  std::vector<std::vector<std::string>> titles;
  std::vector<std::size_t> lines_of_row(rows, 0);
  for (std::size_t i = 0; i < group.size(); ++i) {
    titles.push_back(wrapped(names[i], inner_cm));
    titles.back().push_back(text_of(counts_of({group[i]})));
    lines_of_row[i % rows] = std::max(lines_of_row[i % rows], titles.back().size());
  }
  double titles_cm = 0;
  for (const auto lines : lines_of_row) titles_cm += static_cast<double>(lines) * line_cm + between_cm;
  const Legend legend(entries_of(group), width - left_cm - right_cm);
  const auto others_cm = titles_cm + bottom_cm + legend.height_cm() + 0.2;
  const auto axes_cm =
      rows == 1 ? 3.6 : std::clamp((sheet_cm - others_cm) / static_cast<double>(rows), 0.9, 2.2);

  double end_s = 0;
  for (const auto* run : group)
    end_s = std::max(end_s, static_cast<double>(run->shape.slices.size()) *
                                static_cast<double>(run->shape.slice_ns) / 1e9);
  end_s *= 1.005;  // so that a whole number at the end has its tick
  const auto unit = unit_for(end_s);
  auto range = range_of(group);
  if (counts_of(group).lost > 0)  // room for them above all that was answered
    range.greatest_ms *= std::pow(range.greatest_ms / range.least_ms, 0.12);

  const auto height = others_cm + axes_cm * static_cast<double>(rows);
  Sheet sheet(plot, height);
  sheet.add(fmt::format("set logscale y\nset yrange [{}:{}]\nset y2range [0:1]\nset xrange [0:{}]",
                        range.least_ms, range.greatest_ms, std::max(end_s, 1e-6) / unit.seconds));
  sheet.add(time_tics("y", range.least_ms, range.greatest_ms));
  double top = 0.1;
  std::vector<double> tops;
  for (const auto lines : lines_of_row) {
    tops.push_back(top);
    top += static_cast<double>(lines) * line_cm + axes_cm + between_cm;
  }
  legend.draw(sheet, left_cm, height - legend.height_cm() - 0.1);
  for (std::size_t i = 0; i < group.size(); ++i) {
    const auto row = i % rows;
    const auto left = static_cast<double>(i / rows) * column_cm;
    const auto title_cm = static_cast<double>(lines_of_row[row]) * line_cm;
    const Box axes{left + left_cm, tops[row] + title_cm, left + column_cm - right_cm,
                   tops[row] + title_cm + axes_cm};
    const auto first = lines_of_row[row] - titles[i].size();
    for (std::size_t line = 0; line < titles[i].size(); ++line)
      sheet.text(axes.left, tops[row] + static_cast<double>(first + line) * line_cm + line_cm / 2,
                 titles[i][line], line + 1 == titles[i].size() ? "left textcolor rgb '#555555'" : "left");
    sheet.text(left + 0.2, (axes.top + axes.bottom) / 2, "Round trip", "center rotate");
    const bool lowest = (i + 1) % rows == 0 || i + 1 == group.size();
    sheet.add(lowest ? "set format x '%g'" : "set format x ''");
    if (lowest)
      sheet.text((axes.left + axes.right) / 2, axes.bottom + 0.7, fmt::format("Time ({})", unit.name),
                 "center");
    auto parts =
        parts_of(sheet, *group[i], i, static_cast<std::size_t>(inner_cm * stretches_a_cm), unit.seconds);
    if (parts.empty()) parts.emplace_back("NaN");
    sheet.plot(axes, parts);
  }
  return sheet.commands();
}

}  // namespace ontime::report

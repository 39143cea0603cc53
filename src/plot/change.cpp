// SPDX-License-Identifier: Apache-2.0
// What changed from A to B, as a forest plot: of each metric B / A and its interval.
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include <fmt/format.h>

#include "gate/gate.hpp"
#include "plot/figures.hpp"
#include "report/words.hpp"

namespace ontime::plot {
namespace {

using statistics::Change;
using statistics::Times;
using statistics::Verdict;

using Metric = std::pair<Times, Figure>;
constexpr Metric ratios[] = {{Times::round_trip, Figure::mean},  {Times::round_trip, Figure::p50},
                             {Times::round_trip, Figure::p90},   {Times::round_trip, Figure::p99},
                             {Times::round_trip, Figure::p99_9}, {Times::response, Figure::p99},
                             {Times::response, Figure::p99_9}};
constexpr Metric shares[] = {
    {Times::response, Figure::late}, {Times::round_trip, Figure::late}, {Times::round_trip, Figure::lost}};

// An end of an interval that is farther from its ratio tells no more than one that is open, and would leave
// the rest of the axis too little room.
constexpr double farthest = 1000;

struct Row {
  std::string name;  // of the metric
  Change change;
  bool has_bar;  // else its interval tells nothing and is only the ratio itself
};
struct Panel {
  std::vector<std::string> title;
  std::vector<Row> rows;
  std::vector<std::string> notes;
};

std::string in_three_digits(double number) { return number_text(std::stod(fmt::format("{:.3g}", number))); }

std::pair<const char*, double> unit_of(double ns) {
  return ns >= 999.5e6   ? std::pair{"s", 1e9}
         : ns >= 999.5e3 ? std::pair{"ms", 1e6}
         : ns >= 999.5   ? std::pair{"µs", 1e3}
                         : std::pair{"ns", 1.0};
}

// "15.8 → 0.197 ms", of the unit that the greater one has; "50.1 µs → 1.5 s" where the other would be tiny.
std::string times_text(double from_ns, double to_ns) {
  const auto [unit, size] = unit_of(std::max(from_ns, to_ns));
  if (std::min(from_ns, to_ns) >= size / 100)
    return fmt::format("{} → {} {}", in_three_digits(from_ns / size), in_three_digits(to_ns / size), unit);
  const auto [from_unit, from_size] = unit_of(from_ns);
  const auto [to_unit, to_size] = unit_of(to_ns);
  return fmt::format("{} {} → {} {}", in_three_digits(from_ns / from_size), from_unit,
                     in_three_digits(to_ns / to_size), to_unit);
}

// Runs of one name are told apart by their files.
std::vector<std::string> sides_text(const Comparison& comparison, const Comparison::Pair& pair) {
  const bool is_one_name = gate::name_of(pair.from) == gate::name_of(pair.to);
  const auto text = [&](const char* side, const std::string& of, const Comparison::Runs& runs) {
    return fmt::format("{}: {}{} ({})", side, is_one_name ? of + ", " : "", gate::name_of(runs),
                       many(runs.size(), "run", "runs"));
  };
  return {text("A", comparison.from_name, pair.from), text("B", comparison.to_name, pair.to)};
}

Panel panel_of(const Comparison& comparison, const Comparison::Pair& pair, double width_cm) {
  Panel panel;
  for (const auto& text : sides_text(comparison, pair))
    for (const auto& line : wrapped(text, width_cm)) panel.title.push_back(line);
  for (const auto& [times, figure] : ratios)
    if (auto change = report::change_of(pair, times, figure); change && change->ratio) {
      const bool has_bar = !report::tells_nothing(figure, *change);
      if (!has_bar) change->ratio_lies = {change->ratio, change->ratio};
      panel.rows.push_back({statistics::name_of(times, figure), *change, has_bar});
    }
  for (const auto& [times, figure] : shares)
    if (const auto change = report::change_of(pair, times, figure);
        change && (change->from > 0 || change->to > 0)) {
      const auto& [low, high] = change->lies();
      const bool is_bounded =
          low && high &&
          !(change->ratio && (*low * farthest < *change->ratio || *high > *change->ratio * farthest));
      const auto lies = !is_bounded || report::tells_nothing(figure, *change) ? ""
                        : change->ratio ? fmt::format(", × {} [{}, {}]", in_three_digits(*change->ratio),
                                                      in_three_digits(*low), in_three_digits(*high))
                                        : fmt::format(", difference [{}, {}] points", table::points(*low),
                                                      table::points(*high));
      for (const auto& line :
           wrapped(fmt::format("{}: {} % → {} %{}", statistics::name_of(times, figure),
                               table::percent(change->from, 3), table::percent(change->to, 3), lies),
                   width_cm))
        panel.notes.push_back(line);
    }
  return panel;
}

constexpr const char *blue = "#0072b2", *orange = "#d55e00", *grey = "#666666";

// The table's verdict. Single runs get none, because one start may differ from the next.
const char* colour_of(const Change& change) {
  const auto verdict = change.verdict();
  return verdict == Verdict::worse ? orange : verdict == Verdict::better ? blue : grey;
}

struct Ratios {
  double least = 0.8, greatest = 1.25;
  bool is_cut = false;  // an end of an interval lies beyond
};
// All ratios lie within.
Ratios ratios_of(const std::vector<Panel>& panels) {
  Ratios all;
  for (const auto& panel : panels)
    for (const auto& [name, change, has_bar] : panel.rows)
      for (const auto& ratio : {change.ratio, change.ratio_lies.low, change.ratio_lies.high}) {
        if (!ratio || !std::isfinite(*ratio) || *ratio <= 0) continue;
        if (*ratio > *change.ratio * farthest || *ratio * farthest < *change.ratio) {
          all.is_cut = true;
          continue;
        }
        all.least = std::min(all.least, *ratio / 1.1);
        all.greatest = std::max(all.greatest, *ratio * 1.1);
      }
  return all;
}

// "× 1.5", "× 10,000"; of a greater or smaller power of ten "× 10⁸".
std::string ratio_text(double ratio) {
  constexpr std::array<const char*, 10> digits = {"⁰", "¹", "²", "³", "⁴", "⁵", "⁶", "⁷", "⁸", "⁹"};
  const auto power = std::lround(std::log10(ratio));
  if (std::abs(power) <= 4) return "× " + number_text(ratio);
  std::string text = power < 0 ? "× 10⁻" : "× 10";
  for (const char digit : std::to_string(std::abs(power)))
    text += digits.at(static_cast<std::size_t>(digit - '0'));
  return text;
}

// From 1 outwards, as many as have room for their names: "× 10,000" takes 1.2 cm, and an axis of one column
// has 3.9 cm.
std::string ratio_tics(const Ratios& range) {
  constexpr double name_cm = 1.2, axis_cm = 3.9;
  const auto span = range.greatest / range.least;
  const double apart = std::log(span) * name_cm / axis_cm;
  std::vector<double> ratios;  // on each side in this order
  if (span < 3) ratios = {1.1, 1.2, 1.4, 1.6, 1.8, 2, 2.5, 0.9, 0.8, 0.7, 0.6, 0.5};
  if (span >= 3 && span < 30) ratios = {2, 5, 10, 20, 0.5, 0.2, 0.1, 0.05};
  for (int power = 1; span >= 30 && power <= std::log10(span); ++power)
    for (const int sign : {1, -1}) ratios.push_back(std::pow(10, sign * power));
  std::vector<std::string> tics = {"'× 1' 1"};
  double above = 1, below = 1;
  for (const double ratio : ratios) {
    auto& last = ratio > 1 ? above : below;
    if (ratio < range.least || ratio > range.greatest || std::abs(std::log(ratio / last)) < apart) continue;
    tics.push_back(fmt::format("'{}' {:g}", ratio_text(ratio), ratio));
    last = ratio;
  }
  return fmt::format("set xtics ({})", join(tics, ", "));
}

void draw(Sheet& sheet, const Panel& panel, const Box& axes, const Ratios& range, double row_cm,
          std::size_t number) {
  const auto rows = static_cast<double>(panel.rows.size());
  sheet.add(fmt::format("set yrange [{}:0]", rows));
  sheet.draw(fmt::format("same{}", number), fmt::format("1 0\n1 {}\n", rows),
             "with lines linewidth 0.8 linecolor rgb '#000000'");
  for (std::size_t i = 0; i < panel.rows.size(); ++i) {
    const auto& [name, change, has_bar] = panel.rows[i];
    const auto y = static_cast<double>(i) + 0.5, middle = axes.top + y * row_cm;
    const auto low = std::clamp(change.ratio_lies.low.value_or(range.least), range.least, range.greatest),
               high =
                   std::clamp(change.ratio_lies.high.value_or(range.greatest), range.least, range.greatest);
    sheet.text(axes.left - 0.15, middle, name, "right");
    sheet.text(axes.right + 0.15, middle, times_text(change.from, change.to), "left");
    sheet.draw(
        fmt::format("change{}_{}", number, i),
        fmt::format("{:.6g} {} {:.6g} {:.6g}\n", std::clamp(*change.ratio, range.least, range.greatest), y,
                    low, high),
        fmt::format(
            "using 1:2:3:4 with xerrorbars pointtype 7 pointsize 0.45 linewidth 1.2 linecolor rgb '{}'",
            colour_of(change)));
  }
  sheet.plot(axes);
}

}  // namespace

std::string gnuplot_of(const Comparison& comparison, const Plot& plot) {
  constexpr double left_cm = 2.35, right_cm = 2.6, row_cm = 0.42, bottom_cm = 0.55, last_cm = 0.95,
                   gap_cm = 0.25;
  const auto width = Sheet::width_cm(plot);
  std::vector<Panel> panels;
  Group all;
  bool is_repeated = true;
  for (const auto& pair : comparison.pairs) {
    auto panel = panel_of(comparison, pair, width - 0.5);
    if (panel.rows.empty()) continue;
    panels.push_back(std::move(panel));
    for (const auto* runs : {&pair.from, &pair.to}) all.insert(all.end(), runs->begin(), runs->end());
    is_repeated = is_repeated && report::is_repeated(pair);
  }
  if (panels.empty()) return "";
  const auto range = ratios_of(panels);
  const auto in = [](const char* colour, const char* text) {
    return Entry{text, fmt::format("linewidth 1.2 linecolor rgb '{}'", colour),
                 fmt::format("pointtype 7 pointsize 0.45 linecolor rgb '{}'", colour)};
  };
  std::vector<Entry> entries = {
      in(orange, "B is slower"),
      in(blue, "B is faster"),
      in(grey, is_repeated ? "cannot tell" : "cannot tell, or one run on a side"),
      {range.is_cut ? "bar: 98 % confidence interval; to the edge: not bounded within 1,000 times"
                    : "bar: 98 % confidence interval; to the edge: not bounded"}};
  if (std::ranges::any_of(panels,
                          [](const Panel& panel) { return !std::ranges::all_of(panel.rows, &Row::has_bar); }))
    entries.push_back({"no bar: too few runs or messages to tell"});
  const Legend legend(entries, width - 0.6);
  double height = 0.1 + legend.height_cm() + 0.15 + last_cm - bottom_cm;
  for (const auto& panel : panels)
    height += static_cast<double>(panel.title.size() + panel.notes.size()) * line_cm +
              static_cast<double>(panel.rows.size()) * row_cm + bottom_cm + gap_cm;
  Sheet sheet(plot, height);
  sheet.add(fmt::format(
      "set border 1\nunset ytics\nset grid noytics xtics linetype 1 linewidth 0.4 linecolor rgb '#dddddd'\n"
      "set bars 0\nset logscale x\nset xrange [{}:{}]",
      range.least, range.greatest));
  sheet.add(ratio_tics(range));
  legend.draw(sheet, 0.3, height - legend.height_cm() - 0.1);
  double top = 0.1;
  for (std::size_t i = 0; i < panels.size(); ++i) {
    const auto& panel = panels[i];
    for (const auto& line : panel.title) sheet.text(0.25, (top += line_cm) - line_cm / 2, line);
    const Box axes{left_cm, top + 0.05, width - right_cm,
                   top + 0.05 + static_cast<double>(panel.rows.size()) * row_cm};
    top = axes.bottom + bottom_cm;
    if (i + 1 == panels.size()) {
      sheet.text((axes.left + axes.right) / 2, axes.bottom + 0.65, quantity_of(all) + ", B / A", "center");
      top = axes.bottom + last_cm;
    }
    for (const auto& note : panel.notes) sheet.text(0.25, (top += line_cm) - line_cm / 2, note);
    top += gap_cm - 0.05;
    draw(sheet, panel, axes, range, row_cm, i);
  }
  return sheet.commands();
}

}  // namespace ontime::plot

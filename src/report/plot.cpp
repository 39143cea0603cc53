// SPDX-License-Identifier: Apache-2.0
// Figures for papers, as gnuplot's commands with their data within.
#include <algorithm>
#include <cmath>
#include <map>

#include <fmt/format.h>

#include "report/conditions.hpp"
#include "report/report.hpp"
#include "report/runs.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

using statistics::Summary;

constexpr double column_cm = 8.8, page_cm = 18.2;  // of a paper of two columns, as IEEE and ACM set them
constexpr double panel_cm = 3.4, single_cm = 5.6;
constexpr int font_pt = 7;
constexpr std::uint64_t few = 10;  // messages of a stretch: of these a median says no more than they do
constexpr double pixels_a_cm = 300 / 2.54;  // of a PNG
constexpr const char* colours[] = {"#0072b2", "#d55e00", "#009e73", "#cc79a7",
                                   "#e69f00", "#56b4e9", "#000000"};

// A text of gnuplot's in which nothing is a command of its own: it reads only quotes in these.
std::string quoted(const std::string& text) { return "'" + replace_all(printable(text), "'", "''") + "'"; }

std::string terminal(const Plot& plot, double height_cm) {
  const double width_cm = plot.wide ? page_cm : column_cm;
  switch (plot.form) {
    case Plot::Form::svg:  // of 96 pixels an inch
      return fmt::format(
          "set terminal svg size {:.0f},{:.0f} font 'Helvetica,{:.1f}' linewidth 1 noenhanced "
          "background '#ffffff'\n",
          width_cm / 2.54 * 96, height_cm / 2.54 * 96, font_pt * 96.0 / 72);
    case Plot::Form::pdf:
      return fmt::format("set terminal pdfcairo size {}cm,{}cm font 'Helvetica,{}' linewidth 1 noenhanced\n",
                         width_cm, height_cm, font_pt);
    case Plot::Form::png: {
      const double finer = pixels_a_cm * 2.54 / 96;
      return fmt::format(
          "set terminal pngcairo size {:.0f},{:.0f} font 'Helvetica,{}' fontscale {:.3f} linewidth {:.3f} "
          "pointscale {:.3f} noenhanced\n",
          width_cm * pixels_a_cm, height_cm * pixels_a_cm, font_pt, finer, finer, finer);
    }
  }
  return "";
}

constexpr const char* looks =
    "set encoding utf8\nset border 3 linewidth 0.7\nset tics out nomirror scale 0.5\nset grid ytics linetype "
    "1 linewidth 0.4 "
    "linecolor rgb '#dddddd'\n";

double ms(std::int64_t ns) { return static_cast<double>(ns) / 1e6; }

std::optional<double> deadline_ms(const Summary& summary) {
  const auto& deadline_us = at(summary.run.asked, "deadline_us");
  if (!deadline_us.is_number() || !(deadline_us.get<double>() > 0)) return {};
  return deadline_us.get<double>() / 1e3;
}

// What tells a run from the others of the figure.
std::vector<std::string> names_of(const Group& group) {
  auto names = labels_of(group);
  for (std::size_t i = 0; i < group.size(); ++i) names[i] = id_of(group[i]->run.asked) + "  " + names[i];
  tell_apart(names, group);
  return names;
}

// Least and greatest round trip of all, with the deadline, and room about them: on a logarithmic axis.
std::pair<double, double> range_of(const Group& group) {
  double least = 1e12, greatest = 0;
  for (const auto* summary : group) {
    if (summary->round_trip.count == 0) continue;
    least = std::min(least, ms(summary->round_trip.min));
    greatest = std::max({greatest, ms(summary->round_trip.max), deadline_ms(*summary).value_or(0)});
  }
  if (greatest <= 0) return {0.1, 10};
  return {std::max(least, 1e-6) / 1.4, greatest * 2.2};
}

// Of each slice its time, least, median and greatest round trip, and late and lost ones. No extreme is left
// out.
std::string slices(const Summary& summary, const std::string& name) {
  auto data = fmt::format("${} << END\n", name);
  const auto& shape = summary.shape;
  for (std::size_t i = 0; i < shape.slices.size(); ++i) {
    const auto& slice = shape.slices[i];
    if (slice.sent == 0) continue;
    const auto at_s = (static_cast<double>(i) + 0.5) * static_cast<double>(shape.slice_ns) / 1e9;
    const bool answered = slice.sent > slice.lost;
    const auto value = [&](std::int64_t ns, bool shown) {
      return shown ? fmt::format("{:.6g}", ms(ns)) : "NaN";
    };
    data += fmt::format("{:.6g} {} {} {} {} {}\n", at_s, value(slice.min_ns, answered),
                        value(slice.p50_ns, answered), value(slice.max_ns, answered),
                        value(slice.max_ns, slice.late > 0), slice.lost > 0 ? "1" : "NaN");
  }
  return data + "END\n";
}

std::string over_time(const Group& group, const Plot& plot) {
  const auto names = names_of(group);
  const auto [least, greatest] = range_of(group);
  const std::size_t columns = plot.wide && group.size() > 1 ? 2 : 1;
  const auto rows = (group.size() + columns - 1) / columns;
  auto text = terminal(plot, rows == 1 ? single_cm : panel_cm * static_cast<double>(rows) + 0.6) + looks;
  text +=
      fmt::format("set multiplot layout {},{} columnsfirst downwards\nset logscale y\nset yrange [{}:{}]\n",
                  rows, columns, least, greatest);
  text += "set format y '%g'\nset lmargin 8\nset rmargin 1.5\nset tmargin 1.6\nset key off\n";
  for (std::size_t i = 0; i < group.size(); ++i) {
    const auto& summary = *group[i];
    text += slices(summary, fmt::format("run{}", i));
    const bool lowest = (i + 1) % rows == 0 || i + 1 == group.size();
    text += fmt::format(
        "set title {} offset 0,-0.8\nset xlabel {} offset 0,0.6\nset bmargin {}\nset ylabel {} offset 1\n",
        quoted(fmt::format("{}: {} late, {} lost of {}", names[i], summary.late, summary.lost,
                           grouped(summary.sent))),
        lowest ? "'Time (s)'" : "''", lowest ? 2.6 : 1.6, "'Round trip (ms)'");
    std::vector<std::string> parts;
    if (const auto deadline = deadline_ms(summary))
      parts.push_back(
          fmt::format("{} with lines linewidth 0.8 dashtype 2 linecolor rgb '#d55e00'", *deadline));
    for (const auto* look :
         {"1:2:(0):($4-$2) with vectors nohead linewidth 0.7", "1:2 with points pointtype 7 pointsize 0.12",
          "1:4 with points pointtype 7 pointsize 0.12"})
      parts.push_back(fmt::format("$run{} using {} linecolor rgb '#0072b2'", i, look));
    if (summary.sent > few * summary.shape.slices.size())
      parts.push_back(fmt::format("$run{} using 1:3 with lines linewidth 0.7 linecolor rgb '#000000'", i));
    parts.push_back(
        fmt::format("$run{} using 1:5 with points pointtype 7 pointsize 0.25 linecolor rgb '#d55e00'", i));
    parts.push_back(
        fmt::format("$run{} using 1:($6*{}) with points pointtype 2 pointsize 0.4 linewidth 0.8 linecolor "
                    "rgb '#000000'",
                    i, greatest / 1.2));
    text += "plot " + join(parts, ", \\\n  ") + "\n";
  }
  return text + "unset multiplot\n";
}

// The share of messages slower than the beginning of each bin, where it is exact; lost ones are slower than
// any.
std::string slower(const Summary& summary, const std::string& name) {
  auto data = fmt::format("${} << END\n", name);
  std::uint64_t all = summary.lost;
  for (const auto& bin : summary.shape.round_trip) all += bin.count;
  auto left = all;
  const auto share = [&] { return static_cast<double>(left) / static_cast<double>(all); };
  for (const auto& bin : summary.shape.round_trip) {
    data += fmt::format("{:.6g} {:.6g}\n", ms(bin.from_ns), share());
    left -= bin.count;
  }
  if (left > 0) data += fmt::format("{:.6g} {:.6g}\n", ms(summary.round_trip.max), share());
  return data + "END\n";
}

std::string how_often_worse(const Group& group, const Plot& plot) {
  const auto names = names_of(group);
  const auto [least, greatest] = range_of(group);
  std::uint64_t most = 1;
  for (const auto* summary : group) most = std::max(most, summary->sent);
  auto text = terminal(plot, single_cm + 0.35 * static_cast<double>(group.size())) + looks;
  text += fmt::format("set logscale xy\nset xrange [{}:{}]\nset yrange [{}:1]\n", least, greatest,
                      0.7 / static_cast<double>(most));
  text +=
      "set xlabel 'Round trip (ms)' offset 0,0.5\nset ylabel 'Share of messages slower' offset 1\nset format "
      "x '%g'\n"
      "set format y '%g'\nset key below left Left reverse vertical maxcols 1 samplen 2\n";
  std::string lines;
  if (const auto deadline = deadline_ms(*group.front()))
    text += fmt::format(
        "set arrow from {0}, graph 0 to {0}, graph 1 nohead linewidth 0.8 dashtype 2 linecolor rgb "
        "'#d55e00'\n",
        *deadline);
  for (std::size_t i = 0; i < group.size(); ++i) {
    text += slower(*group[i], fmt::format("run{}", i));
    lines +=
        fmt::format("{}$run{} using 1:2 with steps linewidth 1.4 linecolor rgb '{}' dashtype {} title {}",
                    i == 0 ? "plot " : ", \\\n  ", i, colours[i % std::size(colours)],
                    i / std::size(colours) + 1, quoted(names[i]));
  }
  return text + lines + "\n";
}

std::string against_payload(const Group& group, const Plot& plot) {
  std::map<std::pair<std::string, std::string>, std::map<std::uint64_t, std::vector<const Summary*>>>
      series;  // by id and transport
  for (const auto* summary : group)
    if (summary->round_trip.count > 0)
      series[{word(at(summary->run.asked, "id")), word(at(summary->run.asked, "transport"))}]
            [std::max<std::uint64_t>(count(at(summary->run.asked, "payload_bytes")), 1)]
                .push_back(summary);
  auto text = terminal(plot, single_cm + 0.35 * static_cast<double>(series.size())) + looks;
  text +=
      "set logscale xy\nset xlabel 'Payload (bytes)' offset 0,0.5\nset ylabel 'Round trip (ms): p50, p99 "
      "dashed' "
      "offset 1\nset format y '%g'\nset key below left Left reverse vertical maxcols 1 samplen 2\nset "
      "offsets "
      "graph 0.05, graph 0.05\n";
  std::string lines;
  std::size_t i = 0;
  for (const auto& [name, payloads] : series) {
    text += fmt::format("$run{} << END\n", i);
    for (const auto& [bytes, summaries] : payloads) {
      std::vector<double> p50, p99;
      for (const auto* summary : summaries) {
        p50.push_back(ms(summary->round_trip.p50));
        p99.push_back(ms(summary->round_trip.p99));
      }
      text += fmt::format("{} {:.6g} {:.6g}\n", bytes, statistics::estimate(p50)->median,
                          statistics::estimate(p99)->median);
    }
    text += "END\n";
    const auto* colour = colours[i % std::size(colours)];
    lines += fmt::format(
        "{0}$run{1} using 1:2 with linespoints pointtype 7 pointsize 0.35 linecolor rgb '{2}' title {3}, "
        "\\\n  $run{1} using 1:3 with linespoints pointtype 6 pointsize 0.35 dashtype 2 linecolor rgb "
        "'{2}' notitle",
        i == 0 ? "plot " : ", \\\n  ", i, colour,
        quoted(shortened(name.first, gate::longest_id) + "  " + name.second));
    ++i;
  }
  return text + lines + "\n";
}

}  // namespace

std::string gnuplot_of(const Summaries& summaries, const Plot& plot) {
  const auto group = all_of(summaries);
  switch (plot.figure) {
    case Plot::Figure::worse:
      return how_often_worse(group, plot);
    case Plot::Figure::payload:
      return against_payload(group, plot);
    default:
      return over_time(group, plot);
  }
}

}  // namespace ontime::report

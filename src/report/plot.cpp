// SPDX-License-Identifier: Apache-2.0
// Figures for papers, as gnuplot's commands with their data within.
#include <algorithm>
#include <cmath>
#include <map>
#include <sstream>

#include <fmt/format.h>

#include "gate/gate.hpp"
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
std::string in_quotes(const std::string& text) { return "'" + replace_all(printable(text), "'", "''") + "'"; }

constexpr double pixels_a_pt = 96.0 / 72;  // of an SVG

std::string terminal(const Plot& plot, double height_cm) {
  const double width_cm = plot.wide ? page_cm : column_cm;
  switch (plot.form) {
    case Plot::Form::svg:  // of 96 pixels an inch
      return fmt::format(
          "set terminal svg size {:.0f},{:.0f} font 'Helvetica,{:.1f}' linewidth 1 rounded noenhanced "
          "background '#ffffff'\n",
          width_cm / 2.54 * 96, height_cm / 2.54 * 96, font_pt * pixels_a_pt);
    case Plot::Form::pdf:
      return fmt::format(
          "set terminal pdfcairo size {}cm,{}cm font 'Helvetica,{}' linewidth 1 rounded noenhanced\n",
          width_cm, height_cm, font_pt);
    case Plot::Form::png: {
      const double finer = pixels_a_cm * 2.54 / 96;
      return fmt::format(
          "set terminal pngcairo size {:.0f},{:.0f} font 'Helvetica,{}' fontscale {:.3f} linewidth {:.3f} "
          "pointscale {:.3f} rounded noenhanced\n",
          width_cm * pixels_a_cm, height_cm * pixels_a_cm, font_pt, finer, finer, finer);
    }
  }
  return "";
}

// A line each, of what may be long: an id, and all that tells it from others.
std::string key_below(const Plot& plot) {
  constexpr double key_pt = 5.5;
  return fmt::format(
      "set key below left Left reverse vertical maxcols 1 samplen 2 font ',{:.1f}' title ' '\n",
      plot.form == Plot::Form::svg ? key_pt * pixels_a_pt : key_pt);
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
    greatest = std::max({greatest, ms(summary->round_trip.max), deadline_ms(*summary).value_or(0),
                         summary->skipped_cycles > 0 ? ms(summary->response.max) : 0});
  }
  if (greatest <= 0) return {0.1, 10};
  return {std::max(least, 1e-6) / 1.4, greatest * 2.2};
}

// As long as a line is wide: what is finer nobody sees, and makes a figure of megabytes.
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

// A line, or, where it is none, a dot: gnuplot leaves out what has no length.
std::string segment(double at_s, std::int64_t from_ns, std::int64_t to_ns) {
  const auto to_ms = std::max(ms(to_ns), ms(from_ns) * 1.003);
  return fmt::format("{0:.6g} {1:.6g}\n{0:.6g} {2:.6g}\n\n", at_s, ms(from_ns), to_ms);
}

// By these names: lines from least to greatest, medians, late and lost ones, and the longest wait of cycles
// that passed without a message.
std::string course(const std::vector<Stretch>& stretches, std::size_t run) {
  std::string extents, medians, late, lost, passed;
  for (const auto& [at_s, of] : stretches) {
    const bool answered = of.sent > of.lost;
    if (answered) extents += segment(at_s, of.min_ns, of.max_ns);
    medians += answered ? fmt::format("{:.6g} {:.6g}\n", at_s, ms(of.p50_ns)) : "\n";
    if (of.late > 0) late += segment(at_s, of.max_ns, of.max_ns);
    if (of.lost > 0) lost += fmt::format("{:.6g}\n", at_s);
    if (of.skipped_cycles > 0) passed += segment(at_s, of.response_max_ns, of.response_max_ns);
  }
  std::string data;
  for (const auto& [name, lines] :
       {std::pair{"extents", &extents}, std::pair{"medians", &medians}, std::pair{"late", &late},
        std::pair{"lost", &lost}, std::pair{"passed", &passed}})
    data += fmt::format("${}{} << END\n{}END\n", name, run, lines->empty() ? "NaN NaN\n" : *lines);
  return data;
}

std::string over_time(const Group& group, const Plot& plot) {
  const auto names = names_of(group);
  const auto [least, greatest] = range_of(group);
  const std::size_t columns = plot.wide && group.size() > 1 ? 2 : 1;
  const auto rows = (group.size() + columns - 1) / columns;
  const auto panel_width_cm = (plot.wide ? page_cm : column_cm) / static_cast<double>(columns);
  auto text = terminal(plot, rows == 1 ? single_cm : panel_cm * static_cast<double>(rows) + 0.6) + looks;
  text +=
      fmt::format("set multiplot layout {},{} columnsfirst downwards\nset logscale y\nset yrange [{}:{}]\n",
                  rows, columns, least, greatest);
  text += "set format y '%g'\nset lmargin 8\nset rmargin 1.5\nset tmargin 1.6\nset key off\n";
  for (std::size_t i = 0; i < group.size(); ++i) {
    const auto& summary = *group[i];
    text += course(stretches_of(summary.shape, static_cast<std::size_t>(panel_width_cm * stretches_a_cm)), i);
    const bool lowest = (i + 1) % rows == 0 || i + 1 == group.size();
    text += fmt::format(
        "set title {} offset 0,-0.8\nset xlabel {} offset 0,0.6\nset bmargin {}\nset ylabel {} offset 1\n",
        in_quotes(fmt::format(
            "{}: {} late, {} lost of {}{}", names[i], summary.late, summary.lost, grouped(summary.sent),
            summary.skipped_cycles > 0
                ? fmt::format("; {} cycles without a message", grouped(summary.skipped_cycles))
                : "")),
        lowest ? "'Time (s)'" : "''", lowest ? 2.6 : 1.6, "'Round trip (ms)'");
    std::vector<std::string> parts;
    if (const auto deadline = deadline_ms(summary))
      parts.push_back(
          fmt::format("{} with lines linewidth 0.8 dashtype 2 linecolor rgb '#d55e00'", *deadline));
    parts.push_back(fmt::format("$extents{} with lines linewidth 0.9 linecolor rgb '#0072b2'", i));
    if (summary.sent > few * summary.shape.slices.size())
      parts.push_back(fmt::format("$medians{} with lines linewidth 0.7 linecolor rgb '#000000'", i));
    parts.push_back(fmt::format("$late{} with lines linewidth 2.2 linecolor rgb '#d55e00'", i));
    parts.push_back(fmt::format("$passed{} with lines linewidth 2.2 linecolor rgb '#cc79a7'", i));
    parts.push_back(
        fmt::format("$lost{} using 1:({}) with points pointtype 2 pointsize 0.4 linewidth 0.8 linecolor "
                    "rgb '#000000'",
                    i, greatest / 1.2));
    text += "plot " + join(parts, ", \\\n  ") + "\n";
  }
  return text + "unset multiplot\n";
}

// The share of messages slower than the beginning of each bin, where it is exact; lost ones are slower than
// any.
std::string slower(const Summary& summary, const std::string& name, double least, double greatest) {
  auto data = fmt::format("${} << END\n", name);
  std::uint64_t all = summary.lost;
  for (const auto& bin : summary.shape.round_trip) all += bin.count;
  auto left = all;
  const auto share = [&] { return static_cast<double>(left) / static_cast<double>(all); };
  for (const auto& bin : summary.shape.round_trip) {
    data += fmt::format("{:.6g} {:.6g}\n", ms(bin.from_ns), share());
    left -= bin.count;
  }
  // Those that are left were lost, and stand however slow one asks for.
  if (left > 0) {
    data += fmt::format("{:.6g} {:.6g}\n", summary.round_trip.count > 0 ? ms(summary.round_trip.max) : least,
                        share());
    data += fmt::format("{:.6g} {:.6g}\n", greatest, share());
  }
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
      "set format y '%g'\n" +
      key_below(plot);
  std::string lines;
  if (const auto deadline = deadline_ms(*group.front()))
    text += fmt::format(
        "set arrow from {0}, graph 0 to {0}, graph 1 nohead linewidth 0.8 dashtype 2 linecolor rgb "
        "'#d55e00'\n",
        *deadline);
  for (std::size_t i = 0; i < group.size(); ++i) {
    text += slower(*group[i], fmt::format("run{}", i), least, greatest);
    lines +=
        fmt::format("{}$run{} using 1:2 with steps linewidth 1.4 linecolor rgb '{}' dashtype {} title {}",
                    i == 0 ? "plot " : ", \\\n  ", i, colours[i % std::size(colours)],
                    i / std::size(colours) + 1, in_quotes(names[i]));
  }
  return text + lines + "\n";
}

// Of what a round trip is drawn against.
struct Abscissa {
  const char* key;  // of a scenario
  const char* label;
  double (*of)(const Summary&);  // above 0; else the run is not drawn
  bool marks_misses;
};
constexpr Abscissa payload{
    "payload", "Payload (bytes)",
    [](const Summary& summary) {
      return static_cast<double>(std::max<std::uint64_t>(count(at(summary.run.asked, "payload_bytes")), 1));
    },
    false};
// As asked for, or, where that was more than could be had, as it was.
double rate_of_neighbours_hz(const Summary& summary) {
  const auto& rate = at(at(summary.run.asked, "neighbours"), "rate_hz");
  if (!rate.is_number()) return 0;
  double sent = 0, others = 0;
  bool is_short = false;
  for (const auto* way : {"to_component", "to_controller"}) {
    const auto& counted = at(at(summary.run.outcome, "neighbours"), way);
    is_short = is_short || is_true(at(counted, "short"));
    sent += static_cast<double>(count(at(counted, "sent")));
    for (const auto* other : {"skipped_cycles", "refused"})
      others += static_cast<double>(count(at(counted, other)));
  }
  // Of none that was sent the abscissa has no place: there it is what was asked for, and marked.
  return rate.get<double>() * (is_short && sent > 0 ? sent / (sent + others) : 1);
}
constexpr Abscissa rate_of_neighbours{
    "neighbours.rate", "Neighbours (Hz, each topic and way); × missed or short", rate_of_neighbours_hz, true};

// What a run is drawn with as one line: all that tells it from others, but for what it is drawn against.
std::string line_of(const Summary& summary, const Abscissa& abscissa) {
  const auto& asked = summary.run.asked;
  auto name = shortened(word(at(asked, "id")), gate::longest_id) + "  " + word(at(asked, "transport"));
  if (const auto& component = at(asked, "component"); component.is_string()) name += " " + word(component);
  const auto& search = at(asked, "search");
  if (const auto key = word(at(search, "key")); search.is_object() && key != abscissa.key)
    name += " " + key + " " + word(at(search, "value"));
  std::istringstream parts(
      word(at(search.is_object() ? search : asked, search.is_object() ? "among" : "variant")));
  for (std::string part; std::getline(parts, part, ',');) {
    part.erase(0, part.find_first_not_of(' '));
    if (part.starts_with(std::string(abscissa.key) + " ")) continue;
    name += part.starts_with("options.") ? part.substr(std::min(part.find(' '), part.size())) : " " + part;
  }
  return name;
}

// Where colours begin anew: circles, squares, triangles, lozenges; one more is the same, filled.
constexpr int hollow_points[] = {6, 4, 8, 12};

std::string against(const Abscissa& abscissa, const Group& group, const Plot& plot) {
  std::map<std::string, std::map<double, std::vector<const Summary*>>> series;
  for (const auto* summary : group)
    if (const auto x = abscissa.of(*summary); summary->round_trip.count > 0 && x > 0)
      series[line_of(*summary, abscissa)][x].push_back(summary);
  auto text = terminal(plot, single_cm + 0.35 * static_cast<double>(series.size())) + looks;
  text += fmt::format(
      "set logscale xy\nset xlabel '{}' offset 0,0.5\nset ylabel 'Round trip (ms): p50, p99 "
      "dashed' "
      "offset 1\nset format y '%g'\nset offsets graph 0.05, graph 0.05\n",
      abscissa.label);
  text += key_below(plot);
  std::string lines;
  std::size_t i = 0;
  for (const auto& [name, places] : series) {
    text += fmt::format("$run{} << END\n", i);
    std::string missed;
    for (const auto& [x, summaries] : places) {
      std::vector<double> p50, p99;
      bool any = false;
      for (const auto* summary : summaries) {
        p50.push_back(ms(summary->round_trip.p50));
        p99.push_back(ms(summary->round_trip.p99));
        any = any || summary->late + summary->lost + summary->skipped_cycles > 0 ||
              !at(summary->run.outcome, "error").is_null() ||
              !gate::absent(summary->run.asked, summary->run.outcome).empty();
      }
      const auto y = statistics::estimate(p99)->median;
      text += fmt::format("{:.6g} {:.6g} {:.6g}\n", x, statistics::estimate(p50)->median, y);
      if (any && abscissa.marks_misses) missed += fmt::format("{:.6g} {:.6g}\n", x, y);
    }
    text += "END\n";
    const auto* colour = colours[i % std::size(colours)];
    const int hollow = hollow_points[i / std::size(colours) % std::size(hollow_points)];
    lines += fmt::format(
        "{0}$run{1} using 1:2 with linespoints pointtype {4} pointsize 0.35 linecolor rgb '{2}' title {3}, "
        "\\\n  $run{1} using 1:3 with linespoints pointtype {5} pointsize 0.35 dashtype 2 linecolor rgb "
        "'{2}' notitle",
        i == 0 ? "plot " : ", \\\n  ", i, colour, in_quotes(name), hollow + 1, hollow);
    if (!missed.empty()) {
      text += fmt::format("$missed{} << END\n{}END\n", i, missed);
      lines += fmt::format(
          ", \\\n  $missed{} using 1:2 with points pointtype 2 pointsize 0.7 linecolor rgb '{}' notitle", i,
          colour);
    }
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
      return against(payload, group, plot);
    case Plot::Figure::neighbours:
      return against(rate_of_neighbours, group, plot);
    default:
      return over_time(group, plot);
  }
}

}  // namespace ontime::report

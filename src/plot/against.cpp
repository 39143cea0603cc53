// SPDX-License-Identifier: Apache-2.0
// Round trips against what was varied: the payload, or the rate of the background topics.
#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include <fmt/format.h>

#include "gate/gate.hpp"
#include "plot/figures.hpp"
#include "report/runs.hpp"
#include "report/words.hpp"

namespace ontime::plot {
namespace {

struct Abscissa {
  const char* key;  // of a scenario
  const char* label;
  const char* zero;                             // what it is called where it is 0
  const char* unknown;                          // of runs that are not drawn
  std::optional<double> (*of)(const Summary&);  // nothing: unknown
};
constexpr Abscissa payload{"payload", "Payload (bytes)", "0", "of unknown payload",
                           [](const Summary& summary) {
                             const auto& asked = summary.run.asked;
                             return asked.stated("payload_bytes").is_null()
                                        ? std::nullopt
                                        : std::optional(static_cast<double>(asked.task.client.payload_bytes));
                           }};
// The requested rate, or the achieved one if that fell short.
std::optional<double> rate_of_background_hz(const Summary& summary) {
  const auto& asked = summary.run.asked.task.background;
  if (asked.topics == 0) return 0;
  if (asked.period.count() <= 0) return {};
  const auto rate_hz = 1e9 / static_cast<double>(asked.period.count());
  double sent = 0, others = 0;
  bool is_short = false;
  for (const auto& [way, seen] : summary.run.outcome.background) {
    is_short = is_short || seen.is_short;
    sent += static_cast<double>(seen.sent);
    others += static_cast<double>(seen.skipped_cycles) + static_cast<double>(seen.refused);
  }
  // If none was sent, it is drawn at the requested rate, and marked.
  return rate_hz * (is_short && sent > 0 ? sent / (sent + others) : 1);
}
constexpr Abscissa rate_of_background{"background.rate",
                                      "Background topics: messages/s, each topic and direction", "none",
                                      "of unknown rate", rate_of_background_hz};

bool missed_any(const Summary& summary) {
  const auto fates = statistics::fates_of(summary);
  return fates.not_in_time + fates.skipped > 0 || !statistics::is_complete(summary.run) ||
         !gate::absent(summary.run.asked, summary.run.outcome).empty();
}

// x, the median of the repetitions, their lowest and their highest; nothing where too few were answered.
std::string place(double x, const Group& runs, Figure figure, const Range& range) {
  std::vector<double> values;
  for (const auto* run : sound_of(runs))
    if (run->round_trip.count >= statistics::metric_of(figure).one_in)
      values.push_back(range.at(run->round_trip[figure]));
  if (values.empty()) return "";
  const auto [low, high] = std::ranges::minmax_element(values);
  return fmt::format("{:.6g} {:.6g} {:.6g} {:.6g}\n", x, statistics::estimate(values)->median, *low, *high);
}

// At p99, else at p50; where so few were answered that there is neither, at the deadline or at the top.
std::string place_of_miss(double x, const Group& runs, const Range& range) {
  for (const auto figure : {Figure::p99, Figure::p50})
    if (auto found = place(x, runs, figure, range); !found.empty()) return found;
  const auto deadlines = deadlines_ms(runs);
  return fmt::format("{:.6g} {:.6g}\n", x,
                     std::clamp(deadlines.empty() ? range.greatest_ms : deadlines.back(), range.least_ms,
                                range.greatest_ms));
}

// A logarithmic axis has no place for 0: it stands at the left edge, apart from the others.
struct Axis {
  double least = 1e300, greatest = 0;  // of those above 0
  bool has_zero = false;
  void add(double x) {
    has_zero = has_zero || x <= 0;
    if (x <= 0) return;
    least = std::min(least, x);
    greatest = std::max(greatest, x);
  }
  bool has_others() const { return greatest > 0; }
  double zero() const { return has_others() ? least / std::max(1.5, std::pow(greatest / least, 0.2)) : 1; }
  double at(double x) const { return x > 0 ? x : zero(); }
  double from() const { return (has_zero ? zero() : has_others() ? least : 0.13) / room; }
  double to() const { return (has_others() ? greatest : has_zero ? zero() : 10 / room) * room; }

 private:
  static constexpr double room = 1.3;
};

// Few places have their numbers; else powers of ten have. One that has no room for its number has a tick.
std::string place_tics(const Axis& axis, const std::set<double>& places, const Abscissa& abscissa,
                       double axis_cm) {
  constexpr std::size_t most_named = 5;
  constexpr double gap_cm = 0.15;
  if (places.empty()) return "";
  std::set<double> named;
  if (places.size() <= most_named)
    named = places;
  else
    for (int power = -3; power < 12; ++power)
      if (const auto x = std::pow(10, power); x >= axis.least && x <= axis.greatest) named.insert(x);
  if (named.size() < 2 && places.size() > most_named) named = {axis.least, axis.greatest};
  if (axis.has_zero) named.insert(0);
  auto all = places;
  all.insert(named.begin(), named.end());
  std::vector<std::string> tics;
  double last_cm = -axis_cm;  // where the last number ends
  for (const auto x : all) {
    const auto text = x > 0 ? number_text(x) : abscissa.zero;
    const auto half_cm = text_width_cm(text) / 2;
    const auto at_cm = std::log(axis.at(x) / axis.from()) / std::log(axis.to() / axis.from()) * axis_cm;
    const bool has_room = named.contains(x) && at_cm - half_cm >= last_cm + gap_cm;
    if (has_room) last_cm = at_cm + half_cm;
    tics.push_back(has_room ? fmt::format("'{}' {:.6g}", text, axis.at(x))
                            : fmt::format("'' {:.6g} 1", axis.at(x)));
  }
  return fmt::format("set xtics ({})", join(tics, ", "));
}

// Where colours begin anew: circles, squares, triangles, lozenges; one more is the same, filled.
constexpr int hollow_points[] = {6, 4, 8, 12};

}  // namespace

std::string plot_against(const Group& group, const Plot& plot) {
  const auto& abscissa = plot.figure == Plot::Figure::payload ? payload : rate_of_background;
  constexpr double left_cm = 1.65, right_cm = 0.6, axes_cm = 4.6, bottom_cm = 0.95;
  const auto width = Sheet::width_cm(plot);
  std::map<std::string, std::map<double, Group>> series;
  Axis axis;
  double least = 1e12, greatest = 0;
  std::size_t unknown = 0;
  Group drawn;
  const auto names = lines_against(group, abscissa.key);
  for (std::size_t i = 0; i < group.size(); ++i) {
    const auto* summary = group[i];
    const auto x = abscissa.of(*summary);
    unknown += x ? 0 : 1;
    // What lost all of its messages is the worst there is: it has no round trip, but it has a ×.
    if (!x || (summary->round_trip.count == 0 && !missed_any(*summary))) continue;
    series[names[i]][*x].push_back(summary);
    drawn.push_back(summary);
    axis.add(*x);
    if (summary->round_trip.count == 0) {
      greatest = std::max(greatest, deadline_ms(*summary).value_or(0));
      continue;
    }
    const auto p50 = summary->round_trip[Figure::p50];
    least = std::min(least, p50 > 0 ? ms(p50) : least_positive_ms(*summary));
    greatest = std::max(greatest, ms(summary->round_trip[Figure::p99]));
  }
  const Range range = greatest > 0 ? Range{std::min(least, greatest) / 1.4, greatest * 1.4} : Range{0.1, 10};
  std::vector<Entry> entries;
  struct Data {
    std::string name, lines, with, bars;
  };
  std::vector<Data> data;
  bool any_repeated = false, any_missed = false, any_p50 = false, any_p99 = false;
  for (const auto& [name, places] : series) {
    const auto i = entries.size();
    std::string p50, p99, missed;
    for (const auto& [x, runs] : places) {
      const auto at = axis.at(x);
      for (const auto& [figure, lines] : {std::pair{Figure::p50, &p50}, {Figure::p99, &p99}}) {
        const auto found = place(at, runs, figure, range);
        *lines += found;
        if (x <= 0 && !found.empty())
          *lines += "\n";  // no line leads from 0 to the next: it is off the scale
      }
      any_repeated = any_repeated || runs.size() > 1;
      if (std::ranges::any_of(runs, [](const auto* run) { return missed_any(*run); }))
        missed += place_of_miss(at, runs, range);
    }
    const auto points = hollow_points[i / 7 % std::size(hollow_points)];
    const auto solid = fmt::format("linewidth 1 linecolor rgb '{}'", colour(i));
    const auto filled = fmt::format("pointtype {} pointsize 0.4", points + 1);
    entries.push_back({name, solid, fmt::format("{} linecolor rgb '{}'", filled, colour(i))});
    const auto add = [&](const char* kind, const std::string& lines, const std::string& with) {
      if (lines.empty()) return;  // all messages of all its runs were lost, or there are too few for a p99
      data.push_back(
          {fmt::format("{}{}", kind, i), lines, fmt::format("using 1:2 with linespoints {} {}", with, solid),
           any_repeated ? fmt::format("${}{} using 1:3:(0):($4-$3) with vectors nohead {}", kind, i, solid)
                        : ""});
    };
    any_p50 |= !p50.empty();
    any_p99 |= !p99.empty();
    add("run", p50, filled);
    add("tail", p99, fmt::format("pointtype {} pointsize 0.4 dashtype 2", points));
    if (missed.empty()) continue;
    any_missed = true;
    data.push_back({fmt::format("missed{}", i), missed,
                    "using 1:2 with points pointtype 2 pointsize 0.7 linecolor rgb '#000000'", ""});
  }
  if (any_p50) entries.push_back({"p50", "linewidth 1 linecolor rgb '#000000'", "pointtype 7 pointsize 0.4"});
  if (any_p99)
    entries.push_back({"p99", "linewidth 1 dashtype 2 linecolor rgb '#000000'", "pointtype 6 pointsize 0.4"});
  if (any_p50 && !any_p99) entries.push_back({"no p99: too few answers in a run"});
  if (any_repeated) entries.push_back({"bars: lowest to highest repetition"});
  if (any_missed)
    entries.push_back(
        {"late, lost, skipped, cut off, failed, or load shortfall", "", "pointtype 2 pointsize 0.5"});
  if (unknown > 0)
    entries.push_back({fmt::format("not drawn: {} {}", many(unknown, "run", "runs"), abscissa.unknown)});

  const Legend legend(entries, width - left_cm - right_cm);
  Sheet sheet(plot, 0.2 + axes_cm + bottom_cm + legend.height_cm() + 0.15);
  const Box axes{left_cm, 0.2, width - right_cm, 0.2 + axes_cm};
  sheet.add(fmt::format("set logscale xy\nset yrange [{}:{}]\nset xrange [{}:{}]", range.least_ms,
                        range.greatest_ms, axis.from(), axis.to()));
  sheet.add(time_tics("y", range.least_ms, range.greatest_ms));
  std::set<double> places;
  for (const auto& [name, at] : series)
    for (const auto& [x, runs] : at) places.insert(x);
  if (const auto tics = place_tics(axis, places, abscissa, axes.right - axes.left); !tics.empty())
    sheet.add(tics);
  for (const auto& [name, lines, with, bars] : data) {
    sheet.draw(name, lines, with);
    if (!bars.empty()) sheet.draw(bars);
  }
  sheet.text(0.2, (axes.top + axes.bottom) / 2, report::quantity_of(drawn.empty() ? group : drawn),
             "center rotate");
  sheet.text((axes.left + axes.right) / 2, axes.bottom + 0.7, abscissa.label, "center");
  legend.draw(sheet, left_cm, axes.bottom + bottom_cm);
  if (data.empty()) sheet.draw("NaN notitle");
  sheet.plot(axes);
  return sheet.commands();
}

}  // namespace ontime::plot

// SPDX-License-Identifier: Apache-2.0
// Exceedance (CCDF): the share of messages that are slower than x, lost ones among them. Repetitions are one
// line, and the band goes from the best to the worst of them; of a single run it is the 95 % confidence
// interval. Where cycles were skipped or late from when they were due, it is of response times: round trips
// would leave out just the cycles that waited.
#include <algorithm>
#include <map>
#include <set>

#include <fmt/format.h>

#include "plot/figures.hpp"
#include "report/runs.hpp"
#include "report/words.hpp"

namespace ontime::plot {
namespace {

using statistics::Times;

bool counts_by_response(const Group& group) {
  return std::ranges::any_of(group, [](const auto* run) {
    const auto& client = run->run.asked.task.client;
    return run->skipped_cycles > 0 || report::differs_by_response(*run) ||
           (client.schedule == roundtrip::Schedule::fixed && run->late > 0);
  });
}

const statistics::Distribution& times_of(const Summary& run, Times times) {
  return times == Times::response ? run.response : run.round_trip;
}

// How many messages, or cycles, of all runs took so long or longer.
class Curve {
 public:
  Curve(const Group& runs, Times times) {
    for (const auto* run : runs) {
      lost_ += run->lost;
      for (const auto& bin : times == Times::response ? run->shape.response : run->shape.round_trip) {
        bins_[bin.from_ns] += bin.count;
        bins_.try_emplace(bin.to_ns);  // what follows may be empty
      }
      if (const auto& of = times_of(*run, times); of.count > 0) greatest_ns_ = std::max(greatest_ns_, of.max);
    }
    std::erase_if(bins_, [this](const auto& bin) { return bin.first > greatest_ns_; });
    std::uint64_t left = lost_;
    for (auto bin = bins_.rbegin(); bin != bins_.rend(); ++bin) bin->second = left += bin->second;
    all_ = left;
  }
  bool answered() const { return !bins_.empty(); }
  double lost() const { return share(lost_); }
  // Exact where a bin begins, and within it no more than that.
  double slower(std::int64_t ns) const {
    const auto after = bins_.upper_bound(ns);
    if (after == bins_.begin()) return 1;
    return ns >= greatest_ns_ ? lost() : share(std::prev(after)->second);
  }
  std::vector<std::int64_t> steps() const {
    std::vector<std::int64_t> at;
    for (const auto& [from_ns, left] : bins_) at.push_back(from_ns);
    if (answered()) at.push_back(greatest_ns_);
    return at;
  }

 private:
  double share(std::uint64_t count) const {
    return all_ == 0 ? 0 : static_cast<double>(count) / static_cast<double>(all_);
  }
  std::map<std::int64_t, std::uint64_t>
      bins_;  // by where they begin: those in them and in all after, and lost ones
  std::uint64_t lost_ = 0, all_ = 0;
  std::int64_t greatest_ns_ = 0;
};

// A flight recorder without a histogram knows its counts, but no times: not that all were slow.
Group with_times(Group runs) {
  std::erase_if(runs, [](const auto* run) { return run->round_trip.count == 0 && run->lost < run->sent; });
  return runs;
}

constexpr std::size_t most_intervals = 6;  // more of them hide one another

std::string point(double at_ms, double share) { return fmt::format("{:.6g} {:.6g}\n", at_ms, share); }

std::string line_of(const Curve& curve, const Range& range, double floor) {
  if (!curve.answered()) return point(range.least_ms, 1) + point(range.greatest_ms, 1);
  std::string line;
  for (const auto ns : curve.steps()) line += point(range.at(ns), std::max(curve.slower(ns), floor));
  // Lost ones stay, however slow one asks for.
  if (curve.lost() > 0) line += point(range.greatest_ms, curve.lost());
  return line;
}

// x, and between which shares the repetitions are: stairs.
std::string spread_of(const Group& runs, Times times, const Range& range, double floor) {
  std::vector<Curve> curves;
  std::set<std::int64_t> at;
  for (const auto* run : runs) {
    curves.emplace_back(Group{run}, times);
    for (const auto ns : curves.back().steps()) at.insert(ns);
  }
  std::string band;
  double low = 1, high = 1;
  const auto add = [&](double at_ms) {
    band += fmt::format("{:.6g} {:.6g} {:.6g}\n", at_ms, std::max(low, floor), std::max(high, floor));
  };
  for (const auto ns : at) {
    add(range.at(ns));
    low = 1, high = 0;
    for (const auto& curve : curves) {
      low = std::min(low, curve.slower(ns));
      high = std::max(high, curve.slower(ns));
    }
    add(range.at(ns));
  }
  add(range.greatest_ms);
  return band;
}

// The corners of what the intervals of p50 to p99.99 span, as far as they have both ends; that of p50 alone
// spans nothing.
std::string interval_of(const Summary& run, Times times, const Range& range) {
  const auto& sure = times == Times::response ? run.response_certainty : run.round_trip_certainty;
  const auto all = run.lost + times_of(run, times).count;
  const auto lost = all > 0 ? static_cast<double>(run.lost) / static_cast<double>(all) : 0;
  std::string there, back;
  std::size_t levels = 0;
  for (const auto& row : statistics::percentiles) {
    const auto* of = &sure[row.figure];
    if (!of->sure.low || !of->sure.high) break;
    const auto y = lost + (1 - lost) * row.share_above();
    there += point(range.at(*of->sure.low), y);
    back.insert(0, point(range.at(*of->sure.high), y));
    ++levels;
  }
  return levels < 2 ? "" : there + back;
}

// A colour for what is measured, a dash for the id, if there are enough of both; else one after another.
std::vector<std::string> styles_of(const std::vector<Condition>& conditions) {
  std::vector<std::string> ids, others, styles;
  const auto place = [](std::vector<std::string>& all, const std::string& one) {
    add_once(all, one);
    return static_cast<std::size_t>(std::ranges::find(all, one) - all.begin());
  };
  std::vector<std::pair<std::size_t, std::size_t>> places;
  for (const auto& condition : conditions) {
    const auto& asked = condition.runs.front()->run.asked;
    places.emplace_back(place(others, condition.label), place(ids, id_of(asked)));
  }
  const bool fits = others.size() <= colours && ids.size() <= dashes && ids.size() > 1 && others.size() > 1;
  for (std::size_t i = 0; i < conditions.size(); ++i) {
    const auto [of_colour, of_dash] = fits ? places[i] : std::pair{i % colours, i / colours};
    styles.push_back(fmt::format("linecolor rgb '{}' dashtype {}", colour(of_colour), dash(of_dash)));
  }
  return styles;
}

}  // namespace

std::string plot_ccdf(const Group& group, const Plot& plot) {
  constexpr double left_cm = 1.5, right_cm = 0.45, axes_cm = 5, bottom_cm = 0.95;
  const auto width = Sheet::width_cm(plot);
  const auto conditions = conditions_of(group);
  const auto styles = styles_of(conditions);
  const auto times = counts_by_response(group) ? Times::response : Times::round_trip;
  const bool is_response = times == Times::response;
  const auto range = range_of(group, times);
  std::uint64_t most = 1;
  for (const auto& condition : conditions) {
    const auto counts = counts_of(condition.runs);
    most = std::max(most, counts.sent + (is_response ? counts.skipped_cycles : 0));
  }
  const auto floor = 0.7 / static_cast<double>(most);

  std::vector<Entry> entries;
  bool any_spread = false, any_interval = false;
  std::vector<Group> timed;
  std::vector<std::string> bands(conditions.size()), lines(conditions.size());
  for (std::size_t i = 0; i < conditions.size(); ++i) {
    const auto& runs = timed.emplace_back(with_times(conditions[i].runs));
    const auto counts = counts_of(conditions[i].runs);
    entries.push_back({conditions[i].name + (runs.empty()      ? " (times unknown)"
                                             : runs.size() > 1 ? fmt::format(" ({} runs)", runs.size())
                                                               : ""),
                       "linewidth 1.4 " + styles[i], "",
                       is_response && counts.knows_late ? not_in_time_text(counts) : ""});
    if (runs.empty()) continue;
    lines[i] = line_of(Curve(runs, times), range, floor);
    if (runs.size() > 1)
      bands[i] = spread_of(runs, times, range, floor);
    else if (conditions.size() <= most_intervals)
      bands[i] = interval_of(*runs.front(), times, range);
    (runs.size() > 1 ? any_spread : any_interval) |= !bands[i].empty();
  }
  const auto* const patch = "linewidth 6 linecolor rgb '#cccccc'";
  if (any_spread) entries.push_back({"best to worst of the repetitions", patch});
  if (any_interval)
    entries.push_back(
        {any_spread ? "of a single run: 95 % confidence interval" : "95 % confidence interval", patch});
  const auto deadlines = deadlines_ms(group);
  if (!deadlines.empty()) entries.push_back({deadline_text(deadlines), deadline_style});

  const Legend legend(entries, width - left_cm - right_cm);
  const auto height = 0.2 + axes_cm + bottom_cm + legend.height_cm() + 0.15;
  Sheet sheet(plot, height);
  const Box axes{left_cm, 0.2, width - right_cm, 0.2 + axes_cm};
  sheet.add(fmt::format("set logscale xy\nset xrange [{}:{}]\nset yrange [{}:1]", range.least_ms,
                        range.greatest_ms, floor));
  sheet.add(time_tics("x", range.least_ms, range.greatest_ms));
  sheet.add(share_tics("y", floor));
  for (const auto deadline : deadlines)
    sheet.add(
        fmt::format("set arrow from {0}, graph 0 to {0}, graph 1 nohead {1}", deadline, deadline_style));
  sheet.text(0.2, (axes.top + axes.bottom) / 2,
             is_response ? "Share of cycles slower" : "Share of messages slower", "center rotate");
  sheet.text((axes.left + axes.right) / 2, axes.bottom + 0.7,
             is_response ? "Response time (from when a cycle was due)" : report::quantity_of(group),
             "center");
  legend.draw(sheet, left_cm, axes.bottom + bottom_cm);
  for (std::size_t i = 0; i < conditions.size(); ++i) {
    const bool is_spread = timed[i].size() > 1;
    sheet.draw(fmt::format("band{}", i), bands[i],
               fmt::format("{} with filledcurves {} {} fillstyle transparent solid 0.18 noborder",
                           is_spread ? "using 1:2:3" : "using 1:2", is_spread ? "" : "closed", styles[i]));
  }
  for (std::size_t i = 0; i < conditions.size(); ++i)
    sheet.draw(fmt::format("run{}", i), lines[i], fmt::format("using 1:2 with steps {}", entries[i].line));
  sheet.plot(axes);
  return sheet.commands();
}

}  // namespace ontime::plot

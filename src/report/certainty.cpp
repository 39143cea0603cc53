// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

#include <fmt/format.h>

#include "report/conditions.hpp"
#include "report/runs.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

using statistics::Bound;
using statistics::Certainty;
using statistics::Extremes;
using statistics::Interval;
using statistics::Probability;

constexpr double one_in_a_million = 1e-6;
constexpr double worth_a_word = 3;  // a design effect that widens a bound more than users expect

std::string interval(const Interval& ns) {
  if (!ns.low && !ns.high) return nothing;
  if (!ns.high) return "≥ " + microseconds(*ns.low);
  if (!ns.low) return "≤ " + microseconds(*ns.high);
  return fmt::format("[{}, {}]", microseconds(*ns.low), microseconds(*ns.high));
}

std::string interval(const Probability& of) {
  using table::Limit;
  if (of.messages == 0) return nothing;
  if (of.events == 0) return "≤ " + table::percent(of.bound, 2, Limit::high);
  return fmt::format("[{}, {}]", table::percent(of.sure.low.value_or(0), 2, Limit::low),
                     table::percent(of.sure.high.value_or(1), 2, Limit::high));
}

std::string time(double ns) {
  if (ns >= 2 * 86400e9) return fmt::format("{:.1f} days", ns / 86400e9);
  if (ns >= 2 * 3600e9) return fmt::format("{:.1f} h", ns / 3600e9);
  if (ns >= 2 * 60e9) return fmt::format("{:.0f} min", ns / 60e9);
  if (ns >= 999.5e6) return fmt::format("{:.3g} s", ns / 1e9);
  return fmt::format("{:.3g} ms", ns / 1e6);
}

// How much is needed is rounded up: less would not suffice.
std::string millions(double number) { return fmt::format("{:.1f} million", std::ceil(number / 1e5) / 10); }

std::string note_of(const Summary& summary) {
  const auto& missed = summary.missed_probability;
  if (missed.messages == 0) return "";
  if (missed.events > 0) {
    const auto& bursts = summary.bursts;
    if (bursts.count == 0)  // a late message may have held up the cycles after it
      return differs_by_response(summary) ? "" : "never two late or lost in a row";
    return fmt::format("{} of consecutive late or lost messages; longest: {} messages, due within {}",
                       many(bursts.count, "burst", "bursts"), grouped(bursts.longest),
                       time(static_cast<double>(bursts.longest_ns)));
  }
  if (differs_by_response(summary)) return "";  // its cycles were late
  const auto messages = statistics::messages_to_claim(one_in_a_million, missed.effect);
  const auto effective = static_cast<double>(missed.messages) / missed.effect;
  // How often a message is sent is not known from one.
  const auto takes =
      summary.message_every_ns > 0 ? ", " + time(messages * summary.message_every_ns) : std::string();
  const bool late = statistics::knows_late(summary.run), loss = statistics::knows_loss(summary.run);
  return fmt::format(
      "none {}{}; messages needed to claim < 10⁻⁶: {}{}",
      late && loss ? "late or lost"
      : late       ? "late"
                   : "lost",
      missed.effect < worth_a_word
          ? ""
          : fmt::format("; slow answers come in bursts: {} messages, effective sample size {:.0f}",
                        grouped(missed.messages), std::max(effective, 1.0)),
      millions(messages), takes);
}

ordered_json in_us(const std::optional<double>& ns) {
  if (!ns) return nullptr;
  return std::round(*ns) / 1e3;
}

ordered_json json_of(const Probability& of) {
  if (of.messages == 0) return nullptr;
  return {{"events", of.events},
          {"messages", of.messages},
          {"value", of.value},
          {"low", of.sure.low.value_or(0)},
          {"high", of.sure.high.value_or(1)},
          {"bound", of.bound},
          {"effect", of.effect}};
}

ordered_json json_of(const std::optional<Bound>& of, const std::string& refused) {
  if (!of) return nullptr;
  const bool peaks = of->tail.family == statistics::Tail::Family::peaks;
  return {{"allowed", refused.empty()},
          {"refused", or_null(of->refused.empty() ? refused : of->refused)},
          {"level_us", in_us(of->level)},
          {"level_low_us", in_us(of->level_lies.low)},
          {"level_high_us", in_us(of->level_lies.high)},
          {peaks ? "threshold_us" : "location_us", in_us(of->tail.location)},
          {"scale_us", in_us(of->tail.scale)},
          {"shape", of->tail.shape},
          {"shape_low", of->shape_lies.low.value_or(0)},
          {"shape_high", of->shape_lies.high.value_or(0)},
          {"fit_p", of->fit_p},
          {"count", of->count}};
}

ordered_json json_of(const Extremes& of) {
  const auto tested = [&](double p) { return of.maxima || of.peaks ? ordered_json(p) : ordered_json(); };
  const auto refused = refusal_of(of);
  return {{"refused", or_null(refused)},
          {"exceedance", tested(of.exceedance)},
          {"answers_for_1e-6", tested(of.answers_for_a_million)},
          {"extremal_index", of.index},
          {"trend_p", tested(of.trend_p)},
          {"runs_p", tested(of.runs_p)},
          {"halves_p", tested(of.halves_p)},
          {"block_maxima", json_of(of.maxima, refused)},
          {"peaks_over_threshold", json_of(of.peaks, refused)}};
}

}  // namespace

std::string older_note(const Group& runs) {
  for (const auto* run : runs) {
    const auto& version = run->run.asked.ontime;
    int major = 0, minor = 0;
    if (std::sscanf(version.c_str(), "%d.%d", &major, &minor) == 2 && major == 0 && minor < 2)
      return fmt::format(
          "measured by ontime {}: intervals, worst cases and gates are recomputed and may differ from its "
          "output",
          printable(version));
  }
  return "";
}

// Both methods use the same data: one refusal refuses both. A reason that both give, each with its own number
// in parentheses, appears once.
std::string refusal_of(const Extremes& of) {
  std::vector<std::string> reasons;
  if (!of.refused.empty()) reasons.push_back(of.refused);
  const auto without_figure = [](const std::string& reason) { return reason.substr(0, reason.find(" (")); };
  for (const auto* bound : {&of.maxima, &of.peaks})
    if (*bound && !(*bound)->refused.empty() && std::ranges::none_of(reasons, [&](const std::string& said) {
          return without_figure(said) == without_figure((*bound)->refused);
        }))
      reasons.push_back((*bound)->refused);
  return join(reasons, "; ");
}

std::vector<std::string> unbounded_notes(const std::vector<std::string>& names, const Group& runs) {
  struct Reason {
    std::string text;  // as of the first run
    std::vector<std::size_t> runs;
    bool same = true;
  };
  std::vector<std::pair<std::string, Reason>> reasons;  // by what they are without their figures
  for (std::size_t i = 0; i < runs.size(); ++i) {
    const auto& of = runs[i]->extremes;
    if (runs[i]->round_trip.count == 0) continue;
    const auto why = refusal_of(of);
    if (why.empty()) continue;
    const auto common = why.substr(0, why.find(" ("));
    auto& reason = entry_of(reasons, common);
    if (reason.runs.empty()) reason.text = why;
    reason.same = reason.same && reason.text == why;
    reason.runs.push_back(i);
  }
  return texts_of(reasons, [&](const auto& one) {
    const auto& [common, reason] = one;
    return name_of_some(names, reason.runs) +
           ": no extrapolated worst case: " + (reason.same ? reason.text : common);
  });
}

Table certainty_table(const std::vector<std::string>& labels, const Group& runs) {
  using enum Column::Align;
  Table table{.columns = {{quantity_of(runs) + " (µs)", left},
                          {"p50", right, false, 2},
                          {"p99"},
                          {"p99.9", right, false, 3},
                          {"p99.99", right, false, 1},
                          {"Missed (%)"}}};
  for (std::size_t i = 0; i < runs.size(); ++i) {
    const auto& of = runs[i]->round_trip_certainty;
    const auto& missed =
        differs_by_response(*runs[i]) ? runs[i]->late_by_response_probability : runs[i]->missed_probability;
    if (!of[Figure::p50].sure.low && missed.messages == 0) continue;
    table.rows.push_back({labels[i], interval(of[Figure::p50].sure), interval(of[Figure::p99].sure),
                          interval(of[Figure::p99_9].sure), interval(of[Figure::p99_99].sure),
                          interval(missed)});
    if (const auto note = note_of(*runs[i]); !note.empty()) table.notes.push_back(labels[i] + ": " + note);
    if (!runs[i]->round_trip_certainty.shift && !of[Figure::p50].sure.low && *of[Figure::p50].open != '\0')
      table.notes.push_back(fmt::format("{}: no interval: {}", labels[i], of[Figure::p50].open));
  }
  if (const auto note = older_note(runs); !note.empty() && !table.rows.empty()) table.notes.push_back(note);
  return table;
}

Table worst_case_table(const std::vector<std::string>& labels, const Group& runs) {
  using enum Column::Align;
  Table table{"",
              "Extrapolated worst case: the level that 1 in N answers exceeds (extreme-value theory), with "
              "its 95 % confidence interval. Fit, trend: p-values; a small one makes the level doubtful.",
              {{"Slowest (µs)", left},
               {"Seen", right, false, 1},
               {"1 in"},
               {"Block\nmaxima"},
               {"Fit", right, false, 3},
               {"Peaks over\nthreshold"},
               {"Fit", right, false, 3},
               {"Trend", right, false, 2}}};
  for (std::size_t i = 0; i < runs.size(); ++i) {
    const auto& of = runs[i]->extremes;
    if (runs[i]->round_trip.count == 0 || (!of.maxima && !of.peaks && of.refused.empty())) continue;
    if (!refusal_of(of).empty()) continue;
    const auto level = [](const std::optional<Bound>& bound) {
      return bound ? microseconds(bound->level) + " " + interval(bound->level_lies) : nothing;
    };
    const auto fit = [](const std::optional<Bound>& bound) {
      return bound ? statistics::p_text(bound->fit_p) : nothing;
    };
    table.rows.push_back({labels[i], microseconds(runs[i]->round_trip.max),
                          fmt::format("{:.0f}", 1 / of.exceedance), level(of.maxima), fit(of.maxima),
                          level(of.peaks), fit(of.peaks),
                          of.maxima ? statistics::p_text(of.trend_p) : nothing});
    if (of.exceedance > one_in_a_million)
      table.notes.push_back(fmt::format("{}: a level for 10⁻⁶ exceedance needs {} answers", labels[i],
                                        millions(of.answers_for_a_million)));
  }
  return table;
}

Table stages_table(const std::vector<std::string>& labels, const Group& runs) {
  Table table{.columns = columns_of("p99.9 (µs)", {"Wake-up\nlatency", "Request\nleg", "Server\nturnaround",
                                                   "Reply\nleg", "Round\ntrip", "Response\ntime"})};
  const auto cell = [](const statistics::Distribution& of) { return percentile(of, Figure::p99_9); };
  for (std::size_t i = 0; i < runs.size(); ++i) {
    const auto& run = *runs[i];
    const auto parts = run.parts.value_or(statistics::Parts{});
    if (run.run.asked.is_listened()) continue;  // only one stage
    if (run.response.count < statistics::metric_of(Figure::p99_9).one_in) continue;
    table.rows.push_back({labels[i], cell(run.wake_up), cell(parts.there), cell(run.server), cell(parts.back),
                          cell(run.round_trip), cell(run.response)});
  }
  return table;
}

ordered_json json_of(const Certainty& of) {
  auto result = ordered_json::object();
  const auto add = [&](Figure figure) {
    const auto& measured = of[figure];
    auto& entry = result[statistics::metric_of(figure).name];
    entry = {{"low", in_us(measured.sure.low)},
             {"high", in_us(measured.sure.high)},
             {"supported", measured.sure.low && measured.sure.high},
             {"open", or_null(measured.open)}};
    if (figure != Figure::mean) entry["effect"] = measured.effect;
  };
  add(Figure::mean);
  for (const auto& row : statistics::percentiles) add(row.figure);
  if (of.shift)
    result["shift"] = {
        {"share", of.shift->share},
        {"from_s", of.shift->from_ns ? ordered_json(*of.shift->from_ns / 1e9) : ordered_json()},
        {"before_us", of.shift->before_ns / 1e3},
        {"after_us", of.shift->after_ns / 1e3}};
  return result;
}

void add_certainty(ordered_json& run, const Summary& summary) {
  run["round_trip_95_us"] =
      summary.round_trip.count == 0 ? ordered_json() : json_of(summary.round_trip_certainty);
  run["response_95_us"] = summary.response.count == 0 ? ordered_json() : json_of(summary.response_certainty);
  run["probability"] = {{"late", json_of(summary.late_probability)},
                        {"lost", json_of(summary.lost_probability)},
                        {"missed", json_of(summary.missed_probability)},
                        {"late_by_response", json_of(summary.late_by_response_probability)}};
  run["bursts"] = nullptr;
  if (!summary.has_worst_only)
    run["bursts"] = {{"count", summary.bursts.count},
                     {"longest", summary.bursts.longest},
                     {"longest_ms", static_cast<double>(summary.bursts.longest_ns) / 1e6}};
  run["extremes"] = json_of(summary.extremes);
  const auto& missed = summary.missed_probability;
  const auto messages = statistics::messages_to_claim(one_in_a_million, missed.effect);
  run["to_claim_1e-6"] =
      missed.messages < 2
          ? ordered_json()
          : ordered_json{{"messages", messages}, {"hours", messages * summary.message_every_ns / 3600e9}};
}

}  // namespace ontime::report

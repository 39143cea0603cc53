// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <set>

#include <fmt/format.h>

#include "plot/figures.hpp"
#include "report/answer.hpp"
#include "report/runs.hpp"
#include "report/words.hpp"

namespace ontime::plot {
namespace {

constexpr const char* between_conditions = ", ";

std::string title_of(const Summary& summary) { return shortened(printable(summary.run.asked.title), 60); }

// "Test1.B udp: System under load". Where an id has no title, its conditions are spelled out in its place.
std::vector<std::string> names_with(const Group& group, const std::vector<std::string>& within_id,
                                    const std::vector<std::string>& among_all) {
  const bool titled = std::ranges::all_of(group, [](const auto* run) { return !title_of(*run).empty(); });
  std::vector<std::string> names;
  for (std::size_t i = 0; i < group.size(); ++i) {
    const auto id = id_of(group[i]->run.asked);
    names.push_back(titled ? fmt::format("{} {}: {}", id, within_id[i], title_of(*group[i]))
                           : fmt::format("{} {}", id, among_all[i]));
  }
  return names;
}

template <class Labels>
std::vector<std::string> within_ids(const Group& group, Labels labels_of_group) {
  std::map<std::string, Group> by_id;
  for (const auto* run : group) by_id[id_of(run->run.asked)].push_back(run);
  std::map<const Summary*, std::string> found;
  for (const auto& [id, runs] : by_id) {
    const auto labels = labels_of_group(runs);
    for (std::size_t i = 0; i < runs.size(); ++i) found[runs[i]] = labels[i];
  }
  return texts_of(group, [&](const auto* run) { return found.at(run); });
}

// Not measured to its end or as asked.
bool is_flawed(const Summary* run) { return state_of(*run) >= Answer::State::not_applied; }

}  // namespace

std::vector<std::string> names_of(const Group& group) {
  const auto labels = [](const Group& runs) { return labels_of(runs, between_conditions); };
  auto names = names_with(group, within_ids(group, labels), labels(group));
  tell_apart(names, group);
  for (std::size_t i = 0; i < group.size(); ++i) names[i] += report::unfit_mark({group[i]});
  return names;
}

std::vector<std::string> lines_against(const Group& group, const std::string& key) {
  auto lines = within_ids(
      group, [&](const Group& runs) { return labels_without_repetition(runs, between_conditions, key); });
  for (std::size_t i = 0; i < group.size(); ++i) lines[i] = id_of(group[i]->run.asked) + " " + lines[i];
  return lines;
}

std::vector<Condition> conditions_of(const Group& group) {
  const auto labels_of_runs = [](const Group& runs) {
    return labels_without_repetition(runs, between_conditions);
  };
  const auto labels = within_ids(group, labels_of_runs);
  const auto names = names_with(group, labels, labels_of_runs(group));
  std::vector<Condition> conditions;
  for (std::size_t i = 0; i < group.size(); ++i) {
    const auto same = std::ranges::find(conditions, names[i], &Condition::name);
    if (same != conditions.end())
      same->runs.push_back(group[i]);
    else
      conditions.push_back({names[i], labels[i], {group[i]}});
  }
  for (auto& condition : conditions) condition.name += report::unfit_mark(condition.runs);
  return conditions;
}

std::optional<double> deadline_ms(const Summary& summary) {
  const auto deadline = summary.run.asked.task.client.deadline;
  return deadline.count() > 0 ? std::optional(static_cast<double>(deadline.count()) / 1e6) : std::nullopt;
}

std::vector<double> deadlines_ms(const Group& group) {
  std::set<double> deadlines;
  for (const auto* run : group)
    if (const auto deadline = deadline_ms(*run)) deadlines.insert(*deadline);
  return {deadlines.begin(), deadlines.end()};
}

std::string deadline_text(const std::vector<double>& deadlines) {
  const auto texts = texts_of(
      deadlines, [](double ms) { return duration(std::chrono::nanoseconds(std::llround(ms * 1e6))); });
  return (texts.size() > 1 ? "deadlines " : "deadline ") + join(texts, ", ");
}

double least_positive_ms(const Summary& summary) {
  const auto& all = summary.round_trip;
  if (all.min > 0) return ms(all.min);
  for (const auto& bin : summary.shape.round_trip)
    if (bin.from_ns > 0) return ms(bin.from_ns);
  return all.max > 0 ? ms(all.max) : 1e12;
}

Range range_of(const Group& group, statistics::Times times) {
  double least = 1e12, greatest = 0;
  for (const auto* summary : group) {
    const auto deadline = deadline_ms(*summary).value_or(0);
    greatest = std::max(greatest, deadline);
    if (summary->round_trip.count == 0) continue;
    const bool is_response = times == statistics::Times::response;
    least = std::min(least, least_positive_ms(*summary));
    greatest = std::max({greatest, ms(summary->round_trip.max),
                         is_response || summary->skipped_cycles > 0 ? ms(summary->response.max) : 0});
  }
  if (greatest <= 0) return {0.1, 10};
  return {std::max(std::min(least, greatest / 10), 1e-6) / 1.4, greatest * 1.6};
}

Counts counts_of(const Group& group) {
  Counts all;
  for (const auto* run : group) {
    const auto fates = statistics::fates_of(*run);
    all.sent += fates.sent;
    all.late += fates.late;
    all.lost += fates.lost;
    if (!run->has_worst_only) all.unrecorded += statistics::unrecorded(run->run);
    all.knows_late |= statistics::knows_late(run->run);
    all.knows_loss |= statistics::knows_loss(run->run);
    all.skipped_cycles += fates.skipped;
    all.not_in_time += fates.not_in_time;
    all.differs_by_response |= report::differs_by_response(*run);
  }
  return all;
}

std::string not_in_time_text(const Counts& counts) {
  return fmt::format("{} of {} cycles not in time", grouped(counts.not_in_time),
                     grouped(counts.sent + counts.skipped_cycles));
}

std::string text_of(const Counts& counts) {
  const auto late = grouped(counts.late), lost = grouped(counts.lost), sent = grouped(counts.sent);
  auto text = counts.knows_late && counts.knows_loss ? fmt::format("{} late, {} lost of {}", late, lost, sent)
              : counts.knows_late                    ? fmt::format("{} late of {}; lost unknown", late, sent)
              : counts.knows_loss
                  ? fmt::format("{} lost of {}; no limit", lost, sent)
                  : fmt::format("{}; no limit; lost unknown", many(counts.sent, "message", "messages"));
  if (counts.unrecorded > 0)
    text += fmt::format("; {} not recorded", many(counts.unrecorded, "sample", "samples"));
  if (counts.differs_by_response)
    text += "; " + not_in_time_text(counts);
  else if (counts.skipped_cycles > 0)
    text += fmt::format("; {} without a message", many(counts.skipped_cycles, "cycle", "cycles"));
  return text;
}

Group sound_of(const Group& runs) {
  Group sound = runs;
  std::erase_if(sound, is_flawed);
  return sound.empty() ? runs : sound;
}

std::vector<const Summary*> left_out(const Summaries& summaries, const Plot& plot) {
  Group out;
  if (plot.figure == Plot::Figure::time) return out;
  // Against what was varied, a run that failed or lacked its load has a mark.
  const bool marks = plot.figure == Plot::Figure::payload || plot.figure == Plot::Figure::background;
  for (const auto& condition : conditions_of(last_of(summaries)))
    if (!is_flawed(sound_of(condition.runs).front()))
      std::ranges::copy_if(condition.runs, std::back_inserter(out), [&](const auto* run) {
        return marks ? state_of(*run) == Answer::State::cut_off : is_flawed(run);
      });
  return out;
}

std::string gnuplot_of(const Summaries& summaries, const Plot& plot) {
  auto group = last_of(summaries);
  for (const auto* run : left_out(summaries, plot)) std::erase(group, run);
  using enum Plot::Figure;
  return plot.figure == ccdf         ? plot_ccdf(group, plot)
         : plot.figure == conditions ? plot_conditions(group, plot)
         : plot.figure == time       ? plot_over_time(group, plot)
                                     : plot_against(group, plot);
}

}  // namespace ontime::plot

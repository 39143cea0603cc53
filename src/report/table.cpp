// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <iterator>
#include <utility>

#include <fmt/format.h>

#include "gate/gate.hpp"
#include "report/answer.hpp"
#include "report/comparison.hpp"
#include "report/conditions.hpp"
#include "report/paper.hpp"
#include "report/runs.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

using statistics::Distribution;

std::string share(std::uint64_t part, std::uint64_t whole) { return fmt::format("{}/{}", part, whole); }

std::vector<std::string> row(const std::string& label, const Summary& summary, bool by_response) {
  const auto& of = summary.round_trip;
  const auto value = [&](double ns) { return of.count == 0 ? nothing : microseconds(ns); };
  std::vector<std::string> cells = {label, value(static_cast<double>(of.min)), value(of.mean)};
  for (const auto& metric : statistics::percentiles) cells.push_back(percentile(of, metric.figure));
  cells.push_back(value(static_cast<double>(of.max)));
  cells.push_back(statistics::knows_late(summary.run) ? share(summary.late, summary.sent) : nothing);
  if (by_response)
    cells.push_back(summary.late_by_response
                        ? share(*summary.late_by_response, summary.sent + summary.skipped_cycles)
                        : "?");
  cells.push_back(statistics::knows_loss(summary.run) ? share(summary.lost, summary.sent) : nothing);
  return cells;
}

// The paper's values, in the columns that it has.
std::vector<std::string> row(const PaperRow& paper, bool by_response) {
  std::vector<std::string> cells = {"paper's " + paper.dds, std::to_string(paper.min_us),
                                    std::to_string(paper.avg_us)};
  cells.resize(cells.size() + statistics::percentiles.size());
  cells.push_back(std::to_string(paper.max_us));
  cells.push_back(share(paper.missed_deadlines, paper.messages));
  if (by_response) cells.emplace_back();
  cells.push_back(share(paper.lost, paper.messages));
  return cells;
}

std::vector<Column> columns(const Group& group, bool by_response) {
  using enum Column::Align;
  const bool listened = all_listened(group);
  std::vector<Column> columns = {{quantity_of(group) + " (µs)", left},
                                 {"Min", right, false, 3},
                                 {"Avg", right, false, 2},
                                 {"p50"},
                                 {"p90", right, false, 4},
                                 {"p99"},
                                 {"p99.9", right, false, 5},
                                 {"p99.99", right, false, 1},
                                 {"Max"},
                                 {listened ? "Late" : "Missed\ndeadlines"}};
  if (by_response) columns.push_back({"by\nresponse\ntime"});
  columns.push_back({listened ? "Lost" : "Message\nloss"});
  return columns;
}

// For each group of alike runs with known legs, a line with the medians of its legs.
std::vector<std::string> parts_of(const Group& group) {
  std::vector<std::string> lines;
  for (const auto& [label, runs] : alike(group)) {
    std::vector<double> there, server, back;
    std::int64_t error_ns = 0;
    bool one_clock = true;
    for (const auto* run : runs) {
      if (!run->parts) continue;
      there.push_back(static_cast<double>(run->parts->there[Figure::p50]));
      server.push_back(static_cast<double>(run->server[Figure::p50]));
      back.push_back(static_cast<double>(run->parts->back[Figure::p50]));
      error_ns = std::max(error_ns, run->parts->error_ns);
      one_clock = one_clock && run->parts->one_clock;
    }
    if (there.empty()) continue;
    const auto median = [](const std::vector<double>& values) {
      return microseconds(statistics::estimate(values)->median);
    };
    lines.push_back(fmt::format(
        "{}: medians{}: request leg {} µs, server {} µs, reply leg {} µs ({})", label,
        there.size() > 1 ? fmt::format(" of {} runs", there.size()) : "", median(there), median(server),
        median(back),
        one_clock ? "one clock" : fmt::format("clocks synchronised to ±{} µs", microseconds(error_ns))));
  }
  return lines;
}

// For repeated runs: the range of their metrics from run to run.
Table spread_table(const Group& group, const Summaries& summaries) {
  using enum Column::Align;
  Table table{.columns = {{quantity_of(group) + "\n(µs)", left},
                          {"Runs", right, false, 2},
                          {"p50", right, false, 3},
                          {"p99"},
                          {"p99.9", right, false, 1},
                          {"Max"},
                          {"Missed\n(%)"}}};
  std::vector<std::string> mixtures;
  for (const auto& [label, all] : alike(group)) {
    Group runs;
    std::ranges::copy_if(all, std::back_inserter(runs), [&](const auto* run) {
      return run->sent > 0 && statistics::is_complete(run->run) && !gate::is_superseded(*run, summaries);
    });
    if (runs.size() < 2) continue;
    const auto text = [](double median, double low, double high, std::string (*form)(double)) {
      return fmt::format("{} [{}, {}]", form(median), form(low), form(high));
    };
    const auto time = [&](Figure figure) {
      const auto of = spread_of(runs, figure);
      return of ? text(of->median_ns, of->low_ns, of->high_ns, microseconds) : nothing;
    };
    std::vector<double> missed;
    for (const auto* run : runs) {
      const auto fates = statistics::fates_of(*run);
      missed.push_back(static_cast<double>(fates.not_in_time) /
                       static_cast<double>(fates.sent + fates.skipped));
    }
    const auto [fewest, most] = std::ranges::minmax(missed);
    const bool knows_misses = std::ranges::all_of(runs, [](const auto* run) {
      return statistics::knows_late(run->run) || statistics::knows_loss(run->run);
    });
    table.rows.push_back(
        {label + unfit_mark(runs), fmt::format("{}", runs.size()), time(Figure::p50), time(Figure::p99),
         time(Figure::p99_9), time(Figure::max),
         knows_misses ? text(statistics::estimate(missed)->median, fewest, most, percent) : nothing});
    if (const auto mixture = mixed(runs); !mixture.empty())
      mixtures.push_back(label + ": " + come_from + join(mixture, "; ") + ".");
  }
  mixtures.insert(mixtures.begin(), "Median of the runs [lowest, highest].");
  if (!table.rows.empty()) table.conditions = join(mixtures, " ");
  return table;
}

std::vector<Table> tables_of(const Group& interleaved, const Summaries& summaries,
                             std::optional<std::int64_t> running_from) {
  Group group;
  for (const auto& [label, runs] : alike(interleaved)) group.insert(group.end(), runs.begin(), runs.end());
  const bool by_response =
      std::ranges::any_of(group, [](const auto* summary) { return differs_by_response(*summary); });
  const auto& asked = group.front()->run.asked;
  Table table{.title = id_of(asked),
              .conditions = join(shared_conditions(group), ", "),
              .columns = columns(group, by_response),
              .notes = parts_of(group)};
  if (!asked.title.empty()) table.title += "  " + printable(asked.title);
  auto labels = labels_apart(group);
  for (std::size_t i = 0; i < group.size(); ++i) labels[i] += unfit_mark({group[i]}, running_from);
  for (std::size_t i = 0; i < group.size(); ++i) table.rows.push_back(row(labels[i], *group[i], by_response));
  for (const auto& paper : paper_rows(asked)) table.rows.push_back(row(paper, by_response));
  std::vector<Table> tables = {table};
  const std::pair<Table, const char*> others[] = {
      {spread_table(group, summaries), "over repetitions"},
      {certainty_table(labels, group), "95 % confidence intervals"},
      {worst_case_table(labels, group), "worst case"},
      {stages_table(labels, group), "stage by stage"},
      {searches_table(interleaved), "search"}};
  for (const auto& [other, what] : others) {
    if (other.rows.empty()) continue;
    tables.push_back(other);
    tables.back().title = id_of(asked) + "  " + (other.title.empty() ? what : other.title);
  }
  return tables;
}

// "Test1.B udp"; of runs with one id "udp".
std::vector<std::string> names_of(const std::vector<Group>& groups) {
  std::vector<std::string> names;
  for (const auto& group : groups) {
    for (const auto& label : labels_apart(group))
      names.push_back(groups.size() == 1 ? label : id_of(group.front()->run.asked) + " " + label);
  }
  return names;
}

std::vector<std::string> remarks_of(const std::vector<Group>& groups) {
  Group all;
  for (const auto& group : groups) all.insert(all.end(), group.begin(), group.end());
  const auto names = names_of(groups);
  auto lines = unbounded_notes(names, all);
  for (auto& line : remark_lines(names, all)) lines.push_back(std::move(line));
  return lines;
}

// What columns and signs of these tables mean.
std::string legend_of(const std::vector<Table>& tables, const Summaries& summaries) {
  const auto any = [&](auto&& is_meant) { return std::ranges::any_of(summaries, is_meant); };
  const auto has_column = [&](std::string_view name) {
    return std::ranges::any_of(tables, [&](const Table& table) {
      return std::ranges::find(table.columns, name, &Column::name) != table.columns.end();
    });
  };
  const auto has_cell = [&](auto predicate) {
    return std::ranges::any_of(tables, [&](const Table& table) {
      return std::ranges::any_of(table.rows, [&](const auto& cells) {
        return std::any_of(cells.begin() + 1, cells.end(), predicate);
      });
    });
  };
  const auto begins_with = [](std::string_view sign) {
    return [=](const std::string& cell) { return cell.starts_with(sign); };
  };
  const auto is_listened = [](const Summary& run) { return run.run.asked.is_listened(); };
  const bool has_round_trips = has_column("Message\nloss") &&
                               any([&](const Summary& run) { return !is_listened(run) && !run.imported; });
  std::vector<std::string> texts;
  if ((has_round_trips || has_column("Lost")) && any(is_listened))
    texts.emplace_back(
        "Age: from the writer's timestamp (of a bag: header.stamp, or publish time) until the message was "
        "taken, captured or recorded. Period: from one message to the next. Late: beyond the limit. Lost: "
        "published, and not seen there.");
  if (has_round_trips) {
    auto text = "Missed deadlines: answered later than " +
                common_duration(summaries, &roundtrip::ClientOptions::deadline, "the run's deadline");
    if (any(differs_by_response))
      text +=
          "; by response time: cycles without an answer that long after they were due, of all cycles, "
          "including those without a message";
    texts.push_back(text + ".");
    texts.push_back(
        fmt::format("Message loss: not answered within {}.",
                    common_duration(summaries, &roundtrip::ClientOptions::timeout, "the run's time-out")));
  }
  const auto explain = [&](bool is_there, const char* text) {
    if (is_there) texts.emplace_back(text);
  };
  if (has_column("Missed\n(%)") || has_column("Missed (%)")) {
    const bool has_listened = any(is_listened);
    texts.push_back(!any([&](const Summary& run) { return !is_listened(run) && !run.imported; })
                        ? "Missed (%): late or lost messages, of all messages."
                        : fmt::format("Missed (%): cycles without an answer in time, of all cycles{}.",
                                      has_listened ? "; of a robot's topic late or lost messages" : ""));
  }
  explain(has_cell(begins_with("~")), "~: fewer than 10 messages were slower.");
  explain(has_cell(begins_with("[")), "[low, high]: 95 % confidence interval.");
  explain(has_cell(begins_with("≥")),
          "≥: lower limit only; the effective sample size is too small for an upper limit.");
  explain(has_cell([](const std::string& cell) { return cell == nothing; }),
          "-: too few messages, or unknown.");
  explain(has_round_trips && any_of_paper(summaries), paper_legend);
  return join(texts, " ");
}

}  // namespace

bool any_of_paper(const Summaries& summaries) {
  return std::ranges::any_of(summaries,
                             [](const auto& summary) { return !paper_rows(summary.run.asked).empty(); });
}

bool differs_by_response(const Summary& summary) {
  return summary.late_by_response && *summary.late_by_response != summary.late + summary.lost;
}

std::string percentile(const Distribution& of, Figure figure) {
  const auto one_in = statistics::metric_of(figure).one_in;
  if (of.count < one_in) return nothing;
  const std::uint64_t above = of.count / one_in;
  return (above < 10 ? "~" : "") + microseconds(of[figure]);
}

std::string when_of(const Summaries& summaries) {
  constexpr std::size_t minutes = sizeof("2026-11-30T17:20") - 1, date = sizeof("2026-11-30") - 1;
  std::vector<std::string> starts;
  for (const auto& summary : summaries) {
    const auto& words = summary.run.asked.command_line;
    const bool is_imported = summary.imported || (words.size() > 1 && words[1] == "import");
    auto at = summary.run.started_at.substr(0, minutes);
    if (is_imported || at.size() < minutes || at[date] != 'T') continue;
    at[date] = ' ';
    starts.push_back(printable(at));
  }
  if (starts.empty()) return "";
  const auto [first, last] = std::ranges::minmax(starts);
  const bool same_day = first.substr(0, date) == last.substr(0, date);
  return fmt::format("{}: {}{} UTC", starts.size() == 1 ? "start of the run" : "starts of the runs", first,
                     first == last ? "" : " to " + (same_day ? last.substr(date + 1) : last));
}

Page page_of(const Summaries& summaries, std::optional<std::int64_t> running_from) {
  if (summaries.empty()) return {{}, {"There are no runs."}, ""};
  Page page;
  std::vector<Group> groups;
  for (auto& group : by_id(summaries)) {
    const auto measured =
        std::stable_partition(group.begin(), group.end(), [](const auto* run) { return !run->imported; });
    if (measured != group.begin()) {
      groups.emplace_back(group.begin(), measured);
      for (auto& table : tables_of(groups.back(), summaries, running_from))
        page.tables.push_back(std::move(table));
    }
    if (measured != group.end()) page.tables.push_back(imported_table_of({measured, group.end()}));
  }
  page.notes = remarks_of(groups);
  if (auto when = when_of(summaries); !when.empty()) page.notes.push_back(std::move(when));
  for (auto& refusal : refusals(summaries)) page.notes.push_back(std::move(refusal));
  if (groups.empty()) return page;
  page.legend = legend_of(page.tables, summaries);
  for (auto& table : page.tables) table.legend = legend_of({table::without_unknown(table)}, summaries);
  return page;
}

}  // namespace ontime::report

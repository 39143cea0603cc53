// SPDX-License-Identifier: Apache-2.0
#include "report/comparison.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <span>

#include <fmt/format.h>

#include "report/conditions.hpp"
#include "report/runs.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

using statistics::Tendency;
using statistics::Times;
using statistics::Verdict;
using Pair = Comparison::Pair;
using Runs = Comparison::Runs;

struct Quantity {
  Times times;
  Figure figure;
  bool is_share() const { return statistics::metric_of(figure).is_share; }
  std::string name() const { return statistics::name_of(times, figure) + (is_share() ? " %" : ""); }
  std::string key() const {
    const std::string name = statistics::metric_of(figure).name;
    if (is_share()) return name + (times == Times::response ? "_by_response" : "");
    return (times == Times::response ? "response_us." : "round_trip_us.") + name;
  }
};
constexpr Quantity rows[] = {{Times::round_trip, Figure::mean},  {Times::round_trip, Figure::p50},
                             {Times::round_trip, Figure::p90},   {Times::round_trip, Figure::p99},
                             {Times::round_trip, Figure::p99_9}, {Times::round_trip, Figure::p99_99},
                             {Times::round_trip, Figure::max},   {Times::response, Figure::p99},
                             {Times::response, Figure::p99_9},   {Times::response, Figure::max},
                             {Times::round_trip, Figure::late},  {Times::response, Figure::late},
                             {Times::round_trip, Figure::lost}};

const char* word_of(Verdict verdict) {
  return verdict == Verdict::better ? "better" : verdict == Verdict::worse ? "worse" : "cannot tell";
}

// Single runs get no verdict: the next start may reverse the difference.
const char* word_of(const statistics::Change& change) {
  if (change.repeated || change.tendency == Tendency::unclear) return word_of(change.verdict());
  return change.tendency == Tendency::less ? "lower" : "higher";
}

// --- for people ---

std::string value_of(const Quantity& row, double value) {
  return row.is_share() ? table::percent(value, 4) : microseconds(value);
}

// "+4,110 %"; of what is beyond reading "over 100 times".
std::string in_percent(double ratio) {
  if (ratio > 100) return "over 100 times";
  if (ratio >= 11)
    return fmt::format("+{} %", grouped(static_cast<std::uint64_t>(std::llround((ratio - 1) * 100))));
  const double change = (ratio - 1) * 100, size = std::abs(change);
  const int decimals = ratio > 0 && ratio <= 0.005  ? decimals_that_show(ratio * 100)  // something is left
                       : size > 1e-4 && size < 0.05 ? decimals_that_show(size)         // something changed
                       : size < 10                  ? 1
                                                    : 0;
  return fmt::format("{:+.{}f} %", change, decimals);
}

// In points or µs, with its sign.
std::string difference_of(const Quantity& row, double difference) {
  return row.is_share() ? table::points(difference) : (difference < 0 ? "" : "+") + microseconds(difference);
}

const char* unit_of(const Quantity& row) { return row.is_share() ? " points" : ""; }

// "-3 % … +12 %"; of what has no ratio that of the difference.
std::string lies(const Quantity& row, const statistics::Change& change) {
  const auto ends = [](const auto& low, const auto& high, auto text) {
    if (!low && !high) return std::string(nothing);
    return fmt::format("{} … {}", low ? text(*low) : "", high ? text(*high) : "");
  };
  const auto& [low, high] = change.lies();
  if (change.ratio) return ends(low, high, in_percent);
  const auto text = ends(low, high, [&](double value) { return difference_of(row, value); });
  return text == nothing ? text : text + unit_of(row);
}

// "+9.2 points", "+110 %". The unit is not said again beside an interval that has it.
std::string change_cell(const Quantity& row, const statistics::Change& change) {
  if (change.ratio) return in_percent(*change.ratio);
  if (change.is_of_unequal_numbers || change.from == change.to) return nothing;
  return difference_of(row, change.to - change.from) + (lies(row, change) == nothing ? unit_of(row) : "");
}

bool is_imported(const Pair& pair) { return pair.from.front()->imported && pair.to.front()->imported; }

bool is_single(const Pair& pair) { return whole(pair.from).size() + whole(pair.to).size() <= 2; }

// A percentile that needs more messages than one of the runs has.
bool is_beyond(const Pair& pair, const Quantity& row) {
  return statistics::metric_of(row.figure).one_in > 0 && change_of(pair, row.times, Figure::mean).has_value();
}

std::string list_of(const std::vector<Difference>& differences) {
  return join(texts_of(by_importance(differences), &Difference::words), "; ");
}

// Of imports: what the other tool says of itself, without the options for its output.
std::string command_of(const statistics::Summary& run) {
  const auto& source = run.run.asked.imported;
  std::vector<std::string> words;
  bool skips = false;
  for (const auto& word : split(printable(source ? source->cmdline.value_or("") : ""), ' ')) {
    const bool is_of_output =
        word.starts_with("--json") || word.starts_with("--histfile") || word == "-q" || word == "--quiet";
    if (!is_of_output && !skips && !word.empty()) words.push_back(word);
    skips = word == "--json" || word == "--histfile";  // its file comes next
  }
  return join(words, " ");
}

std::vector<Difference> import_differences(const Pair& pair) {
  constexpr std::size_t longest = 100;
  const auto one_of = [](const Runs& runs, auto text_of_run) {
    std::vector<std::string> texts;
    for (const auto* run : runs) add_once(texts, shortened(text_of_run(*run), longest));
    return join(texts, " or ");
  };
  std::vector<Difference> found;
  const auto add = [&](const char* what, auto text_of_run) {
    const auto from = one_of(pair.from, text_of_run), to = one_of(pair.to, text_of_run);
    if (from != to && !from.empty() && !to.empty())  // a text file has neither
      found.push_back({"", what, from, to, fmt::format("{}: {} → {}", what, from, to)});
  };
  add("command line", command_of);
  add("rt-tests", [](const auto& run) {
    const auto& version = run.run.asked.stated("imported.rt_test_version");
    return version.is_null() ? "" : word(version);
  });
  return found;
}

// "idle udp", or "demo udp → demo cyclonedds" where the sides have other names.
std::string title_of(const Pair& pair) {
  const auto from = gate::name_of(pair.from), to = gate::name_of(pair.to);
  return from == to ? to : from + " → " + to;
}

std::uint64_t answers_of(const Runs& runs) {
  std::uint64_t answers = 0;
  for (const auto* run : whole(runs)) answers += run->round_trip.count;
  return answers;
}

// "A: before.ontime, 3 runs; B: after.ontime, 2 of 3 runs", where one is left out.
std::string sides_text(const Comparison& comparison, const Pair& pair) {
  const auto side = [](const char* letter, const std::string& name, const Runs& runs) {
    const auto used = whole(runs).size();
    return fmt::format("{}: {}{}{}", letter, name == letter ? "" : name + ", ",
                       used < runs.size() ? fmt::format("{} of ", used) : "",
                       many(runs.size(), "run", "runs"));
  };
  return side("A", comparison.from_name, pair.from) + "; " + side("B", comparison.to_name, pair.to) +
         (is_single(pair) ? "" : "; each value is their mean, max the greatest");
}

Table table_of(const Comparison& comparison, const Pair& pair) {
  const Group all{pair.from.front(), pair.to.front()};
  Table table{title_of(pair), join(shared_conditions(all), ", "),
              columns_of(quantity_of(all) + " (µs)", {"A", "B", "Change", "98 % interval"})};
  table.columns.push_back({"B is", Column::Align::left});
  for (const auto& row : rows) {
    const auto change = change_of(pair, row.times, row.figure);
    if (!change) {
      if (is_beyond(pair, row))
        table.rows.push_back({row.name(), nothing, nothing, nothing, nothing, "too few messages"});
      continue;
    }
    // A far percentile, or few messages or runs, leave it unknown.
    const auto& [low, high] = change->lies();
    const bool too_few = tells_nothing(row.figure, *change);
    table.rows.push_back({row.name(), value_of(row, change->from), value_of(row, change->to),
                          too_few ? nothing : change_cell(row, *change),
                          too_few ? nothing : lies(row, *change),
                          change->is_of_unequal_numbers ? "not compared"
                          : !too_few                    ? word_of(*change)
                          : !low && !high               ? "no interval"
                          : is_single(pair)             ? "too few messages"
                                                        : "too little data"});
  }
  if (table.rows.empty())
    table.notes.push_back("nothing to compare: no message was answered, or no run is complete");
  table.notes.insert(table.notes.begin(), sides_text(comparison, pair));
  if (!table.rows.empty() && !is_repeated(pair))
    table.notes.push_back(
        "a side of one run cannot tell better from worse: its start-to-start variation is unknown. Fix: five "
        "runs a side");
  if (const auto max = change_of(pair, Times::round_trip, Figure::max); max && max->is_of_unequal_numbers) {
    table.notes.push_back(
        fmt::format("max is not compared: more answers have a greater one. A: {} answers, B: {}",
                    grouped(answers_of(pair.from)), grouped(answers_of(pair.to))));
  }
  std::vector<std::string> names;
  Runs named;
  for (const auto* runs : {&pair.from, &pair.to})
    for (const auto* run : *runs) {
      named.push_back(run);
      const auto& name =
          names.emplace_back(fmt::format("{} of {}", gate::name_of(*run), runs == &pair.from ? "A" : "B"));
      if (gate::lacks_samples(gate::flaw_of(*run)))
        table.notes.push_back(fmt::format("left out: {}: {}", name, gate::unfit(*run)));
      else if (run->round_trip.count == 0)
        table.notes.push_back(fmt::format("left out of round trips: {}: no message was answered", name));
    }
  for (auto& line : remark_lines(names, named)) table.notes.push_back(std::move(line));
  if (const auto text = list_of(other_differences(comparison, pair)); !text.empty())
    table.notes.push_back("also different (A → B): " + text);
  for (const auto* runs : {&pair.from, &pair.to})
    if (const auto text = older_note(*runs); !text.empty())
      table.notes.push_back(fmt::format("{} was {}", runs == &pair.from ? "A" : "B", text));
  return table;
}

std::vector<Difference> all_differences(const Pair& pair) {
  auto all = import_differences(pair);
  std::ranges::move(differences(pair), std::back_inserter(all));
  return all;
}

// Of imported runs the mean of a percentile, or the greatest maximum.
struct WakeUp {
  double ns = 0;
  bool is_least = false;  // beyond the histogram of one: a lower limit
};
// Nothing: a run has too few values.
std::optional<WakeUp> wake_up_of(const Runs& runs, Figure figure) {
  WakeUp all;
  for (const auto* run : runs) {
    if (run->wake_up.count < std::max<std::uint64_t>(statistics::metric_of(figure).one_in, 1)) return {};
    const auto ns = static_cast<double>(run->wake_up[figure]);
    all.ns = figure == Figure::max ? std::max(all.ns, ns) : all.ns + ns / static_cast<double>(runs.size());
    all.is_least = all.is_least || statistics::is_lower_bound(*run, figure);
  }
  return all;
}
constexpr Figure wake_up_figures[] = {Figure::p50,   Figure::p90,    Figure::p99,
                                      Figure::p99_9, Figure::p99_99, Figure::max};

// Imported values have no order in time.
Table imported_table_of(const Comparison& comparison, const Pair& pair) {
  Table table{gate::name_of(pair.to), "imported wake-up latencies; no confidence interval, so no verdict",
              columns_of("Wake-up (µs)", {"A", "B"})};
  const auto cell = [](const Runs& runs, Figure figure) {
    const auto of = wake_up_of(runs, figure);
    return of ? (of->is_least ? "≥" : "") + microseconds(of->ns) : nothing;
  };
  for (const auto figure : wake_up_figures)
    table.rows.push_back(
        {statistics::metric_of(figure).name, cell(pair.from, figure), cell(pair.to, figure)});
  table.notes.push_back(sides_text(comparison, pair));
  auto differences = all_differences(pair);
  if (is_imported(pair))  // which has no other host
    for (auto& difference : differences)
      if (!difference.host.empty()) difference.host = Difference::both;
  if (const auto text = list_of(differences); !text.empty())
    table.notes.push_back("also different (A → B): " + text);
  return table;
}

// A record may have a name of any length.
std::string name_of(const Runs& runs) {
  constexpr std::size_t longest = 100;
  return shortened(gate::name_of(runs), longest);
}

std::string list_of(const std::vector<Runs>& groups) {
  auto names = names_apart(groups);
  for (std::size_t i = 0; i < names.size(); ++i)
    names[i] += fmt::format(" ({})", many(groups[i].size(), "run", "runs"));
  return join(names, "; ");
}

// --- for programs ---

ordered_json optional(const std::optional<double>& value, double unit) {
  return value ? ordered_json(*value / unit) : ordered_json();
}

// Of two intervals only the one that decides: the other may say otherwise.
ordered_json json_of(const std::string& metric, bool is_share, const statistics::Change& change) {
  const double unit = is_share ? 1 : 1e3;
  const auto difference_lies = change.ratio ? statistics::Interval() : change.difference_lies;
  return {{"metric", metric},
          {"from", change.from / unit},
          {"to", change.to / unit},
          {"difference",
           change.is_of_unequal_numbers ? ordered_json() : ordered_json((change.to - change.from) / unit)},
          {"difference_low", optional(difference_lies.low, unit)},
          {"difference_high", optional(difference_lies.high, unit)},
          {"ratio", optional(change.ratio, 1)},
          {"ratio_low", optional(change.ratio_lies.low, 1)},
          {"ratio_high", optional(change.ratio_lies.high, 1)},
          {"verdict", word_of(change.verdict())},
          {"figure", metric}};  // the earlier name, kept for one version
}

const char* json_word_of(gate::Judgement::Result result) {
  using Result = gate::Judgement::Result;
  return result == Result::held ? "held" : result == Result::missed ? "missed" : "cannot judge";
}

ordered_json runs_json_of(const Runs& runs) {
  auto numbers = ordered_json::array(), left_out = ordered_json::array();
  for (const auto* run : runs)
    if (gate::lacks_samples(gate::flaw_of(*run)))
      left_out.push_back({{"run", run->run.number}, {"why", gate::unfit(*run)}});
    else
      numbers.push_back(run->run.number);
  const auto& first = runs.front()->run;
  return {{"key", first.key},
          {"id", first.asked.stated("id")},
          {"variant", first.asked.stated("variant")},
          {"transport", first.asked.stated("transport")},
          {"runs", numbers},
          {"left_out", left_out}};
}

// The metrics that both sides have.
ordered_json metrics_of(const Pair& pair) {
  auto metrics = ordered_json::array();
  for (const auto& row : rows)
    if (const auto change = change_of(pair, row.times, row.figure))
      metrics.push_back(json_of(row.key(), row.is_share(), *change));
  if (!is_imported(pair)) return metrics;
  const auto values_of = [](const Runs& runs) {
    std::uint64_t values = 0;
    for (const auto* run : runs) values += run->wake_up.count;
    return values;
  };
  const auto [fewer, more] = std::minmax({values_of(pair.from), values_of(pair.to)});
  for (const auto figure : wake_up_figures) {
    const auto from = wake_up_of(pair.from, figure), to = wake_up_of(pair.to, figure);
    if (!from || !to || from->is_least || to->is_least) continue;
    statistics::Change change;
    change.from = from->ns;
    change.to = to->ns;
    change.is_of_unequal_numbers = figure == Figure::max && more > fewer + fewer / 10;
    if (change.from > 0 && !change.is_of_unequal_numbers) change.ratio = change.to / change.from;
    metrics.push_back(
        json_of(std::string("wake_up_us.") + statistics::metric_of(figure).name, false, change));
  }
  return metrics;
}

ordered_json json_of(const Pair& pair) {
  const auto not_the_same = array_of(all_differences(pair), [](const Difference& one) {
    return ordered_json{{"what", one.name()}, {"from", one.from}, {"to", one.to}};
  });
  const auto metrics = metrics_of(pair);
  return {{"from", runs_json_of(pair.from)}, {"to", runs_json_of(pair.to)},
          {"repeated", is_repeated(pair)},   {"metrics", metrics},
          {"not_the_same", not_the_same},    {"figures", metrics}};  // the earlier name, kept for one version
}

// Of all runs without a partner, the two that differ least, and their differences.
std::string nearest(const Comparison& comparison) {
  constexpr std::size_t most = 20;  // of a side: each is held against each
  std::string nearest;
  std::size_t least = 0;
  for (const auto& from : std::span(comparison.only_from).first(std::min(most, comparison.only_from.size())))
    for (const auto& to : std::span(comparison.only_to).first(std::min(most, comparison.only_to.size()))) {
      if (quantity_of(from) != quantity_of(to)) continue;
      auto different = key_differences(*from.front(), *to.front());
      if (from.front()->run.asked.stated("flow") != to.front()->run.asked.stated("flow"))
        different.emplace_back("flow");  // the names have its processes
      if (different.empty() || (least != 0 && different.size() >= least)) continue;
      least = different.size();
      nearest = fmt::format(
          "Nearest: {} of {} and {} of {}. Different: {}. To compare them anyway{}: --from {} --to {}",
          name_of(from), comparison.from_name, name_of(to), comparison.to_name, join(different, "; "),
          comparison.key.empty() ? "" : " (without --by)", from.front()->run.number, to.front()->run.number);
    }
  return nearest;
}

}  // namespace

std::vector<std::string> names_apart(const std::vector<Runs>& groups) {
  auto names = texts_of(groups, [](const Runs& runs) { return name_of(runs); });
  std::map<std::string, std::vector<std::size_t>> alike;
  for (std::size_t i = 0; i < names.size(); ++i) alike[names[i]].push_back(i);
  for (const auto& [name, places] : alike) {
    if (places.size() == 1) continue;
    Group group;
    for (const auto place : places) group.push_back(groups[place].front());
    const auto labels = labels_without_repetition(group);
    for (std::size_t i = 0; i < places.size(); ++i) {
      const auto& asked = group[i]->run.asked;  // a label begins with the transport
      const auto rest =
          asked.is_listened() ? 0 : std::min(labels[i].size(), word(asked.task.transport).size() + 1);
      if (rest < labels[i].size()) names[places[i]] += " " + labels[i].substr(rest);
    }
  }
  return names;
}

bool tells_nothing(Figure figure, const statistics::Change& change) {
  if (figure == Figure::max || change.tendency != Tendency::unclear) return false;
  const auto& [low, high] = change.lies();
  if (!change.ratio && !statistics::metric_of(figure).is_share) return !low && !high;
  return (!low || *low < (change.ratio ? 0.5 : -0.1)) && (!high || *high > (change.ratio ? 2 : 0.1));
}

Page page_of(const Comparison& comparison, const std::vector<gate::Judgement>& judgements) {
  Page page;
  for (const auto& pair : comparison.pairs)
    page.tables.push_back(is_imported(pair) ? imported_table_of(comparison, pair)
                                            : table_of(comparison, pair));
  if (comparison.pairs.empty()) {
    page.notes.push_back(fmt::format("No run of {} has the same conditions as one of {}.",
                                     comparison.from_name, comparison.to_name));
    if (auto note = nearest(comparison); !note.empty()) page.notes.push_back(std::move(note));
    if (const auto why = why_never(comparison); !why.empty()) page.notes.push_back("Reason: " + why + ".");
  }
  for (const auto& [name, runs] : {std::pair(&comparison.from_name, &comparison.only_from),
                                   std::pair(&comparison.to_name, &comparison.only_to)})
    if (!runs->empty()) page.notes.push_back(fmt::format("Only in {}: {}", *name, list_of(*runs)));
  for (const auto& judgement : judgements)
    if (!judgement.says.empty()) page.notes.push_back(gate::text_of(judgement));
  if (!std::ranges::all_of(comparison.pairs, is_imported))
    page.legend =
        "98 % interval: confidence interval of the change. Cannot tell: chance may explain the difference.";
  return page;
}

ordered_json json_of(const Comparison& comparison, const std::vector<gate::Judgement>& judgements) {
  const auto gates = array_of(judgements, [](const gate::Judgement& judgement) {
    return ordered_json{{"gate", judgement.gate},
                        {"run", judgement.run},
                        {"result", json_word_of(judgement.result)},
                        {"says", judgement.says}};
  });
  return {{"ontime", ONTIME_VERSION},
          {"pairs", array_of(comparison.pairs, [](const Pair& pair) { return json_of(pair); })},
          {"only_from", array_of(comparison.only_from, runs_json_of)},
          {"only_to", array_of(comparison.only_to, runs_json_of)},
          {"gates", gates}};
}

std::string csv_of(const Comparison& comparison) {
  std::vector<std::string> header = {"id",     "variant",   "transport", "key_from",
                                     "key_to", "runs_from", "runs_to"};
  std::vector<std::vector<std::string>> lines;
  for (const auto& pair : comparison.pairs)
    for (const auto& metric : metrics_of(pair)) {
      const auto from = runs_json_of(pair.from), to = runs_json_of(pair.to);
      lines.push_back({cell_of(to.at("id")), cell_of(to.at("variant")), cell_of(to.at("transport")),
                       cell_of(from.at("key")), cell_of(to.at("key")),
                       std::to_string(whole(pair.from).size()), std::to_string(whole(pair.to).size())});
      for (const auto& [name, value] : metric.items()) {
        if (lines.size() == 1) header.push_back(name);
        lines.back().push_back(cell_of(value));
      }
    }
  return as_csv(header, lines);
}

}  // namespace ontime::report

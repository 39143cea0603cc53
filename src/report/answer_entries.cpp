// SPDX-License-Identifier: Apache-2.0
#include "report/answer_entries.hpp"

#include <algorithm>
#include <array>
#include <map>
#include <utility>

#include <fmt/format.h>

#include "gate/gate.hpp"
#include "report/comparison.hpp"
#include "report/conditions.hpp"
#include "report/runs.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

// Of a robot's own messages, nothing may tell which were late or lost.
bool knows_missed(const record::Run& run) {
  return statistics::knows_late(run) || statistics::knows_loss(run);
}

using gate::Flaw;
using Row = Answer::Row;
using State = Answer::State;

// "load, RT". Only a scenario says that a machine was idle: `ontime ping` does not know what else runs.
std::string in_words(const Summary& run) {
  const auto regime = regime_of(run);
  auto words = words_of(regime.stress, " beside it");
  if (words.empty() && !run.run.asked.scenario_file.empty()) words.emplace_back("idle");
  words.insert(words.end(), regime.tuned.begin(), regime.tuned.end());
  return join(words, ", ");
}

struct Wait {
  double ns;
  bool is_open;  // no answer ended it, or none whose time is known
};
Wait worst_wait_of(const Summary& run) {
  const auto& client = run.run.asked.task.client;
  const auto fates = statistics::fates_of(run);
  const auto ended_ns =
      static_cast<double>(std::max({run.response.max, run.round_trip.max, run.lost_wait_ns}));
  auto open_ns = static_cast<double>(run.open_wait_ns);
  // Where samples are missing, the client's counts tell at least how long the waits were.
  if (fates.lost > run.lost) open_ns = std::max(open_ns, static_cast<double>(client.timeout.count()));
  if (fates.late > run.late) open_ns = std::max(open_ns, static_cast<double>(client.deadline.count()));
  return {std::max(ended_ns, open_ns), open_ns > 0 && open_ns >= ended_ns};
}

Row row_of(const Group& runs, const std::string& name, std::optional<std::int64_t> running_from) {
  const auto& first = *runs.front();
  Row row;
  row.id = id_of(first.run.asked);
  row.conditions = in_words(first);
  row.name = runs.size() == 1 ? name : fmt::format("{} ×{}", name, runs.size());
  for (const auto* run : runs) {
    row.runs.push_back(run->run.number);
    row.state = std::max(row.state, state_of(*run, running_from));
    row.missed_requirement = row.missed_requirement || has_note(*run, gate::missed_note);
    row.open_requirement = row.open_requirement || has_note(*run, gate::open_note);
    if (run->imported) continue;
    row.knows_missed = row.knows_missed || knows_missed(run->run);
    const auto fates = statistics::fates_of(*run);
    row.cycles += fates.sent + fates.skipped;
    row.missed += fates.not_in_time;
    const auto [wait_ns, is_open] = worst_wait_of(*run);
    const auto before_ns = row.worst_wait_ns.value_or(0);
    if (wait_ns > before_ns) row.worst_wait_ns = wait_ns;
    if (wait_ns > 0 && wait_ns >= before_ns) row.is_open = is_open || (row.is_open && wait_ns == before_ns);
  }
  row.p50 = spread_of(runs, Figure::p50);
  row.p99 = spread_of(runs, Figure::p99);
  // A run without an answer hides no slow answer of another.
  for (const auto* run : runs)
    if (const auto& of = run->imported ? run->wake_up : run->round_trip; of.count > 0)
      row.max_ns = std::max(row.max_ns.value_or(0), static_cast<double>(of[Figure::max]));
  return row;
}

}  // namespace

Regime regime_of(const Summary& run) {
  const auto& asked = run.run.asked;
  std::vector<Stress> stress;
  std::vector<std::string> tuned;
  const auto add = [&](const char* what, bool is_own, bool is_of_another) {
    if (is_own || is_of_another) stress.push_back({what, !is_own});
  };
  const auto& others = asked.others;
  add("load", asked.controller_load.any() || asked.component_load.any(), others.load);
  add("traffic", asked.traffic.any(), others.traffic);
  add("background topics", asked.task.background.topics > 0, others.topics);
  add("link faults", asked.faults.disturb(), false);
  if (asked.task.realtime.on) tuned.emplace_back("RT");
  if (!asked.kernel.empty()) tuned.emplace_back("kernel settings");
  if (!asked.isolation.cpus.empty()) tuned.emplace_back("reserved CPUs");
  if (asked.isolation.limits()) tuned.emplace_back("load limits");
  const auto& link = asked.faults;
  if (!link.qdisc.empty() || link.message_priority || link.traffic_priority)
    tuned.emplace_back("traffic control");
  if (link.dscp) tuned.emplace_back("DSCP");
  return {stress, tuned, asked.is_listened()};
}

std::vector<std::string> words_of(const std::vector<Stress>& stress, const char* of_another) {
  return texts_of(stress,
                  [&](const Stress& one) { return one.what + (one.is_of_another ? of_another : ""); });
}

std::vector<Entry> entries_of(const Summaries& summaries, std::optional<std::int64_t> running_from) {
  std::vector<Entry> entries;
  for (const auto& all : by_id(summaries)) {
    Group group;
    std::ranges::copy_if(all, std::back_inserter(group),
                         [&](const auto* run) { return !gate::is_superseded(*run, summaries); });
    // A search measures its steps in another order. Each search stands where its first run does.
    using Search = std::array<std::string, 3>;
    const auto search_of = [](const Summary* run) {
      const auto& asked = run->run.asked;
      return asked.step.key.empty() ? Search{}
                                    : Search{asked.task.transport, asked.step.key, asked.step.among};
    };
    std::map<Search, std::size_t> places;
    for (const auto* run : group) places.try_emplace(search_of(run), places.size());
    const auto place_of = [&](const Summary* run) {
      return std::pair(places.at(search_of(run)), run->run.asked.step.number);
    };
    std::stable_sort(group.begin(), group.end(),
                     [&](const auto* a, const auto* b) { return place_of(a) < place_of(b); });
    for (const auto& [label, runs] : alike(group)) {
      // A row is about the repetitions that have ended, if there are any.
      auto ended = runs;
      std::erase_if(ended, [&](const auto* run) { return state_of(*run, running_from) == State::running; });
      const auto& of = ended.empty() ? runs : ended;
      entries.push_back({of, row_of(of, label, running_from)});
    }
  }
  return entries;
}

double share_of(const Row& row) {
  return static_cast<double>(row.missed) / static_cast<double>(std::max<std::uint64_t>(row.cycles, 1));
}

std::string name_of(const Row& row, bool with_id) { return with_id ? row.id + " " + row.name : row.name; }

std::vector<std::string> cautions_of(const std::vector<Entry>& entries) {
  Group runs;
  std::vector<std::size_t> row_of_run;
  std::vector<std::string> names;
  const bool several_ids = entries.front().row.id != entries.back().row.id;
  for (std::size_t i = 0; i < entries.size(); ++i) {
    names.push_back(name_of(entries[i].row, several_ids));
    for (const auto* run : entries[i].runs)
      if (!run->imported) {
        runs.push_back(run);
        row_of_run.push_back(i);
      }
  }
  auto remarks = shared_remarks(runs);
  gather_requirements(remarks, texts_of(runs, [](const auto* run) { return gate::name_of(*run); }));
  std::vector<std::string> cautions;
  const auto about = [&](std::vector<std::size_t> places, const std::string& text) {
    std::ranges::sort(places);
    places.erase(std::unique(places.begin(), places.end()), places.end());
    if (places.size() == names.size()) return cautions.push_back(text);
    std::vector<std::string> named;
    for (const auto place : places) {
      // All rows of a condition have its name, if they are several.
      const auto& id = entries[place].row.id;
      const auto rows = std::ranges::count_if(entries, [&](const Entry& one) { return one.row.id == id; });
      const auto told = std::ranges::count_if(places, [&](auto row) { return entries[row].row.id == id; });
      add_once(named, several_ids && rows > 1 && told == rows ? id : names[place]);
    }
    // Longer names would leave no words of a caution that is cut to one line.
    constexpr std::size_t longest = 40;
    auto whose = join(named, ", ");
    if (named.size() > 1 && whose.size() > longest)
      whose = fmt::format("{} of {} rows", places.size(), names.size());
    cautions.push_back(whose + ": " + text);
  };
  using enum Remark::Requirement;
  const auto add = [&](Remark::Requirement requirement, Remark::Weight weight = Remark::Weight::caution) {
    for (const auto& remark : remarks) {
      if (remark.weight != weight || remark.requirement != requirement) continue;
      std::vector<std::size_t> places;
      for (const auto run : remark.runs) places.push_back(row_of_run[run]);
      about(places, remark.text);
    }
  };
  add(missed);  // the exit code tells of these
  add(open);
  add(none, Remark::Weight::not_applied);
  // Each once, and those of the same rows together.
  std::vector<std::pair<std::string, std::vector<std::size_t>>> mixtures;
  for (std::size_t i = 0; i < entries.size(); ++i)
    for (const auto& text : mixed(entries[i].runs)) entry_of(mixtures, text).push_back(i);
  std::vector<std::pair<std::vector<std::size_t>, std::vector<std::string>>> by_rows;
  for (const auto& [text, places] : mixtures) entry_of(by_rows, places).push_back(text);
  for (const auto& [places, texts] : by_rows) about(places, come_from + join(texts, "; "));
  std::vector<std::string> denied;
  std::size_t denied_in = 0;
  for (const auto* run : runs) {
    const auto of_run = gate::denied(run->run.outcome);
    denied_in += of_run.empty() ? 0 : 1;
    for (const auto& asked : of_run) add_once(denied, word(asked));
  }
  if (denied_in > 0)
    cautions.push_back(fmt::format(
        "denied{}: {}", runs.size() > 1 ? fmt::format(" in {} of {} runs", denied_in, runs.size()) : "",
        join(denied, ", ")));
  add(none);
  std::uint64_t fewest = UINT64_MAX;
  for (const auto* run : runs)
    if (run->sent > 0) fewest = std::min(fewest, run->round_trip.count);
  const auto* const where = runs.size() > 1 ? " in a run" : "";
  const auto* const what = all_listened(runs) ? "messages" : "answers";
  if (fewest < statistics::metric_of(Figure::p99).one_in)
    cautions.push_back(fmt::format("too few {} ({}{}) for p99", what, grouped(fewest), where));
  else if (fewest < 1000)
    cautions.push_back(fmt::format("few {} ({}{}): p99 is a rough estimate", what, grouped(fewest), where));
  else if (fewest < 30'000 && fewest != UINT64_MAX)  // 30 must be slower: statistics/course.cpp
    cautions.push_back(fmt::format("{} {}{}: too few for an upper limit of {}", grouped(fewest), what, where,
                                   fewest < 3'000 ? "p99 (3,000)" : "p99.9 (30,000)"));
  return cautions;
}

State state_of(const Summary& run, std::optional<std::int64_t> running_from) {
  const bool is_late = statistics::fates_of(run).not_in_time > 0;
  switch (gate::flaw_of(run)) {
    case Flaw::imported:
      return State::imported;
    case Flaw::failed:
      return State::failed;
    case Flaw::cut_off:
      return running_from && run.run.number >= *running_from && !run.run.outcome.has_ended() ? State::running
                                                                                             : State::cut_off;
    case Flaw::worst_only:  // its counts are of all messages
    case Flaw::none:
      return is_late ? State::late : knows_missed(run.run) ? State::ok : State::no_limit;
    default:
      break;
  }
  // `ontime listen` requests nothing: its late and lost messages count even where samples are missing.
  return run.run.asked.is_listened() && is_late ? State::late : State::not_applied;
}

std::string unfit_mark(const Group& runs, std::optional<std::int64_t> running_from) {
  auto worst = State::imported;
  for (const auto* run : runs) worst = std::max(worst, state_of(*run, running_from));
  return worst > State::late ? fmt::format(" ({})", word_of(worst)) : "";
}

bool has_note(const Summary& run, const char* kind) {
  return std::ranges::find(run.notes, kind, &record::Note::kind) != run.notes.end();
}

std::optional<Answer::Spread> spread_of(const Group& runs, Figure figure) {
  const auto one_in = std::max<std::uint64_t>(statistics::metric_of(figure).one_in, 1);
  std::vector<double> values;
  bool is_least = false;
  for (const auto* run : runs) {
    const auto& of = run->imported ? run->wake_up : run->round_trip;
    if (of.count >= one_in)
      values.push_back(static_cast<double>(of[figure]));
    else if (statistics::is_complete(run->run))
      return std::nullopt;
    is_least = is_least || statistics::is_lower_bound(*run, figure);
  }
  if (values.empty()) return std::nullopt;
  const auto [low, high] = std::ranges::minmax_element(values);
  return Answer::Spread{*low, statistics::estimate(values)->median, *high, is_least};
}

}  // namespace ontime::report

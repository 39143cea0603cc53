// SPDX-License-Identifier: Apache-2.0
#include "search_trials.hpp"

#include <algorithm>
#include <set>
#include <sstream>
#include <thread>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "explain/explain.hpp"
#include "flags.hpp"
#include "gate/gate.hpp"
#include "measured.hpp"
#include "output.hpp"
#include "search_report.hpp"

namespace ontime::app {
namespace {

using campaign::Error;
using namespace std::chrono_literals;

// Kinds of notes: one for each run that counts; the others for the first run, with the search's subject.
constexpr const char *run_note = "search", *goal_note = "search-goal", *about_note = "search-run",
                     *settings_note = "search-settings";
constexpr int most_attempts = 3;
constexpr auto pause = 5s;

std::string order_text(const search::Order& order, const std::string& without_settings = words_of({})) {
  return fmt::format("search, trial {}, run {}: {}", order.trial, order.number,
                     order.set.empty() ? without_settings : words_of(order.set));
}

// As results files have it, also those of earlier versions.
std::string note_of(const search::Order& order) { return order_text(order, "nothing"); }

bool is_of_a_search(const record::Run& run) {
  const auto& words = run.asked.command_line;
  return std::ranges::count(words, "tune") > 0 && std::ranges::count(words, "search") > 0;
}

std::set<std::string> parts_of(const std::string& list) {
  std::set<std::string> parts;
  std::istringstream stream(list);
  for (std::string part; std::getline(stream, part, ';');)
    if (const auto begin = part.find_first_not_of(' '); begin != part.npos) parts.insert(part.substr(begin));
  return parts;
}

// The entries that only the first list has.
std::string without(const std::string& list, const std::string& other) {
  const auto mine = parts_of(list), theirs = parts_of(other);
  std::vector<std::string> only;
  std::set_difference(mine.begin(), mine.end(), theirs.begin(), theirs.end(), std::back_inserter(only));
  return only.empty() ? "nothing" : fmt::format("{}", fmt::join(only, "; "));
}

[[noreturn]] void refuse(const std::string& results, const std::string& what) {
  throw wrong("--resume: {} {}. Repeat the command of that search, or name a new file", results, what);
}

std::string kind_of_machine(const record::Run& run) {
  return record::find(run.outcome.hosts, record::both_hosts[0]).machine.simulated.value_or("");
}

std::string machine_named(const std::string& machine) {
  return machine.empty() ? "a real machine" : "simulated by " + machine;
}

// Throws where the results are of another search.
void compare(const std::vector<record::Note>& notes, const auto& known, const Subject& subject,
             const std::string& results) {
  const record::Run& first = known.front().run;
  const auto noted = [&](const char* kind) {
    const auto found = std::ranges::find_if(notes, [&](const auto& note) { return note.kind == kind; });
    return found == notes.end() ? "unknown" : found->text;
  };
  for (const auto& [kind, word, mine] :
       {std::tuple{goal_note, "goal", &subject.goal}, {about_note, "run", &subject.run}})
    if (const auto theirs = noted(kind); theirs != *mine)
      refuse(results,
             fmt::format("holds a search with another {}: '{}'; this one has '{}'", word, theirs, *mine));
  if (const auto theirs = kind_of_machine(first); theirs != subject.machine)
    refuse(results, fmt::format("holds a search on another machine: {}; this one is {}",
                                machine_named(theirs), machine_named(subject.machine)));
  for (const auto& one : known)
    if (statistics::is_complete(one.run)) check_machines(one.run, subject.machines);
  if (const auto theirs = noted(settings_note); theirs != subject.settings)
    refuse(results,
           fmt::format("holds a search of other settings. Only in the file: {}. Only in this search: {}",
                       without(theirs, subject.settings), without(subject.settings, theirs)));
  if (first.asked.scenario != subject.scenario)
    refuse(results, "holds a search of another scenario, or the scenario has changed");
}

std::vector<std::string> denied_settings(const record::Run& run) {
  std::vector<std::string> all;
  for (const auto* host : record::both_hosts)
    for (const auto& refusal : record::find(run.outcome.hosts, host).refusals)
      all.push_back(fmt::format("on the {}, {}: {}", host, refusal.asked, refusal.found));
  return all;
}

// A setting keeps the run's value until the run restores it, unless another process changes it.
std::string changed_by_another(const record::Run& run) {
  for (const auto& [name, host] : run.outcome.hosts)
    for (const auto& change : host.kernel)
      if (!change.lasted())
        return fmt::format(
            "another process changed {} ({}) on the {} from {} to {}. The search stops and leaves it "
            "unchanged. Stop that process, then search again",
            change.setting, change.thing, name, change.after.dump(), change.now.dump());
  return "";
}

}  // namespace

std::string settings_of(const record::Reader& reader) {
  for (const auto& run : reader.runs())
    for (const auto& note : reader.notes(run.number))
      if (note.kind == settings_note) return note.text;
  return "";
}

bool is_among(const std::string& settings, const search::Setting& setting) {
  constexpr std::string_view between = " or ";
  const auto framed = [&](std::string_view text) { return fmt::format("{0}{1}{0}", between, text); };
  for (const auto& part : parts_of(settings))
    if (const auto head = setting.key + ": "; part.starts_with(head))
      return framed(part.substr(head.size())).find(framed(setting.value)) != std::string::npos;
  return false;
}

std::string machine_of(const record::Reader& reader) {
  const auto runs = reader.runs();
  return runs.empty() ? "" : kind_of_machine(runs.front());
}

Trials::Trials(Subject subject, ScenarioWith scenario_with, const std::vector<search::Part>& goal,
               const search::Bounds& bounds, Clock::time_point until, Places places)
    : subject_(std::move(subject)),
      scenario_with_(std::move(scenario_with)),
      goal_(goal),
      bounds_(bounds),
      until_(until),
      places_(places) {}

void Trials::recall(const std::string& results) {
  results_ = results;
  const auto reader = places_.writer.reader();
  std::vector<record::Note> all;
  for (auto& run : reader.runs()) {
    if (!is_of_a_search(run))
      refuse(results,
             fmt::format("holds no search: run {} ({}) is from another command", run.number, run.asked.id));
    const auto notes = reader.notes(run.number);
    all.insert(all.end(), notes.begin(), notes.end());
    const auto found = std::ranges::find_if(notes, [](const auto& note) { return note.kind == run_note; });
    // It was cut off, or its failure may pass.
    if (found == notes.end() || !run.outcome.has_ended()) continue;
    known_.push_back({found->text, std::move(run)});
  }
  if (!known_.empty()) compare(all, known_, subject_, results);
  is_subject_noted_ = !known_.empty();
}

std::optional<search::Answer> Trials::measure(const search::Order& order) {
  if (!stopped_.empty()) return {};
  try {
    const auto scenario = scenario_with_(order.set);
    if (const auto run = recalled(order, scenario)) {
      auto answer = answer_of(*run);
      answer.is_recalled = true;
      return answer;
    }
    if (end_) return stop(end_->first, end_->second);
    return attempts(order, scenario);
  } catch (const scenario::Error& error) {  // its keys contradict one another
    return search::Answer{{}, {}, error.what()};
  }
}

std::nullopt_t Trials::stop(const std::string& why, int code) {
  stopped_ = why;
  code_ = code;
  return std::nullopt;
}

std::optional<record::Run> Trials::recalled(const search::Order& order, const campaign::Scenario& scenario) {
  if (known_.empty()) return {};
  auto [text, run] = std::move(known_.front());
  known_.pop_front();
  if (text != note_of(order) || run.asked.scenario != scenario.text)
    throw wrong("--resume: run {} of {} (ontime {}) is '{}', but ontime " ONTIME_VERSION
                " expects '{}'. Use a new results file",
                run.number, results_, run.asked.ontime, text, note_of(order));
  return run;
}

std::optional<search::Answer> Trials::attempts(const search::Order& order,
                                               const campaign::Scenario& scenario) {
  std::string failure;
  const int most = denied_at_first_ ? most_attempts : 1;
  for (int attempt = 1; attempt <= most; ++attempt) {
    if (attempt > 1 && !wait_after(failure)) return stop("interrupted", 130);
    const auto time = std::chrono::duration_cast<Clock::duration>(campaign::time_of(scenario));
    if (Clock::now() + time > until_)
      return stop(fmt::format("no time left (--within): a run takes about {}", about(time)), 1);
    try {
      return measured(order, scenario);
    } catch (const Error& error) {
      if (error.exit != 3) return stop(error.what(), error.exit);
      failure = error.what();
    }
  }
  return stop(failure, 3);
}

// False: interrupted.
bool Trials::wait_after(const std::string& failure) {
  places_.terminal.note(fmt::format("{}; retry in {} s", failure, pause.count()));
  for (const auto end = Clock::now() + pause; Clock::now() < end && places_.interrupts == 0;)
    std::this_thread::sleep_for(100ms);
  return places_.interrupts == 0;
}

// Throws Error for failures that are not the set's.
std::optional<search::Answer> Trials::measured(const search::Order& order,
                                               const campaign::Scenario& scenario) {
  auto& writer = places_.writer;
  const auto last = [&] {
    const auto runs = writer.reader().runs();
    return runs.empty() ? 0 : runs.back().number;
  };
  places_.terminal.note(order_text(order));
  const auto before = last();
  const int code = campaign::execute(scenario, writer, places_.terminal, places_.interrupts, command_line());
  if (code == 130 || places_.interrupts > 0) return stop("interrupted", 130);
  places_.terminal.does("judging the run");
  const auto number = last();
  if (number == before) throw Error(code == 0 ? 3 : code, "no run was measured");
  const auto run = writer.reader().runs(number).front();
  if (const auto text = changed_by_another(run); !text.empty()) return stop(text, 3);
  const auto& outcome = run.outcome;
  if (outcome.error && outcome.refused_setting.empty() && !outcome.unanswered)
    throw Error(code, *outcome.error);
  note_run(number, order);
  return answer_of(run);
}

void Trials::note_run(std::int64_t number, const search::Order& order) {
  auto& writer = places_.writer;
  if (!std::exchange(is_subject_noted_, true))
    for (const auto& [kind, text] : {std::pair{goal_note, subject_.goal},
                                     {about_note, subject_.run},
                                     {settings_note, subject_.settings}})
      writer.note(number, {kind, text, {}, {}});
  writer.note(number, {run_note, note_of(order), {}, {}});
  writer.flush();
  places_.counts(number);
}

search::Answer Trials::answer_of(const record::Run& run) {
  const auto reader = places_.writer.reader();
  const auto summary = statistics::summarise(reader, run);
  const auto& outcome = run.outcome;
  if (outcome.error && !outcome.refused_setting.empty())
    return {{}, {}, *outcome.error, false, outcome.refused_setting};
  if (gate::flaw_of(summary) != gate::Flaw::denied)
    if (auto why = gate::unfit(summary); !why.empty()) return {{}, {}, std::move(why), true};
  if (auto why = denied(run); !why.empty()) return {{}, {}, std::move(why)};
  search::Answer answer;
  std::int64_t slow_ns = 0;
  for (const auto& part : goal_) {
    answer.tallies.push_back(search::tally_of(part, summary));
    const auto limit_ns = static_cast<std::int64_t>(part.gate.limit);
    if (!statistics::metric_of(part.gate.figure).is_share)
      slow_ns = slow_ns == 0 ? limit_ns : std::min(slow_ns, limit_ns);
  }
  answer.findings = search::findings_of(explain::account_of(reader, run), run, slow_ns, bounds_);
  return answer;
}

// A setting of the process that was denied, other than what the scenario itself was denied; "": none.
std::string Trials::denied(const record::Run& run) {
  const auto all = denied_settings(run);
  if (!denied_at_first_) denied_at_first_ = all;
  const auto found = std::ranges::find_if(all, [&](const std::string& one) {
    return std::find(denied_at_first_->begin(), denied_at_first_->end(), one) == denied_at_first_->end();
  });
  return found == all.end() ? "" : *found;
}

}  // namespace ontime::app

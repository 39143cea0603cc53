// SPDX-License-Identifier: Apache-2.0
// The search for the smallest set of settings by which a scenario meets a goal.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <map>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "campaign/campaign.hpp"
#include "commands.hpp"
#include "flags.hpp"
#include "isolation/groups.hpp"
#include "measured.hpp"
#include "output.hpp"
#include "results_page.hpp"
#include "scenario_files.hpp"
#include "search/goal.hpp"
#include "search_lacks.hpp"
#include "search_report.hpp"
#include "search_trials.hpp"
#include "spelling/spelling.hpp"
#include "terminal.hpp"

namespace ontime::app {
namespace {

using campaign::Error;
using Seconds = std::chrono::duration<double>;

constexpr const char* usual_time = "2 h";
constexpr int usual_priority = 80;
constexpr double too_many_runs = 24;  // to prove that a goal holds

struct Arguments {
  std::string scenario, goal, within = usual_time, results, keep_cpus_off, format = "table";
  std::vector<std::string> never;
  Choice choice;
  std::optional<int> below_priority;
  bool resume = false;
};

campaign::Scenario scenario_of(const Arguments& arguments, const std::string& file,
                               campaign::Selection selection, const search::Set& set) {
  selection.explain = true;
  selection.set = set;
  auto scenario = campaign::read_scenario(file, selection);
  if (scenario.runs.size() != 1 || scenario.hosts.components.size() != 1)
    throw Error(
        2,
        fmt::format("tune search: {} has {} runs and {} components, and a search is of one run between two "
                    "hosts: choose with --only and --transports, and state no lists",
                    arguments.scenario, scenario.runs.size(), scenario.hosts.components.size()));
  scenario.repeat = 1;
  return scenario;
}

// A whole key, or the last word of one or more.
void check_never(const std::string& name) {
  const auto keys = search::knob_keys();
  auto words = keys;
  for (const auto& key : keys) words.push_back(key.substr(key.rfind('.') + 1));
  if (std::find(words.begin(), words.end(), name) != words.end()) return;
  throw Error(2, fmt::format("--never: a search does not set '{}'{}. It may set: {}", name,
                             spelling::suggestion(name, words), fmt::join(keys, ", ")));
}

// Where anything may be put: the CPUs of this process, which a container may limit, without those that the
// user keeps.
std::vector<int> cpus_of(const Arguments& arguments) {
  auto cpus = isolation::cpus_of_thread(getpid());
  if (arguments.keep_cpus_off.empty()) return cpus;
  const auto there = realtime::list_of(cpus);
  const auto off = realtime::cpus_of(arguments.keep_cpus_off);
  if (!off)
    throw Error(2, fmt::format("--keep-cpus-off: '{}' is no list of CPUs such as 0 or 0-1,3; there are: {}",
                               arguments.keep_cpus_off, there));
  for (const int cpu : *off)
    if (std::erase(cpus, cpu) == 0)
      throw Error(2, fmt::format("--keep-cpus-off: there is no CPU {} here; there are: {}", cpu, there));
  if (cpus.empty())
    throw Error(
        2, fmt::format("--keep-cpus-off: {} leaves no CPU; there are: {}", arguments.keep_cpus_off, there));
  return cpus;
}

search::Bounds bounds_of(const Arguments& arguments, const campaign::Scenario& scenario) {
  search::Bounds bounds;
  for (const auto& name : arguments.never) {
    check_never(name);
    bounds.never.insert(name);
  }
  const int own = campaign::application_priority(scenario.runs.front());
  bounds.below_priority = arguments.below_priority.value_or(own > 0 ? own : usual_priority);
  bounds.cpus = cpus_of(arguments);
  bounds.cannot = lacks_of(scenario);
  return bounds;
}

// How long the search may take at least, by its first trial.
struct Plan {
  Seconds of_run{0};
  double runs = 1;  // of the first trial: to prove that the goal holds, where it does

  Seconds of_trial() const { return of_run * runs; }
  std::string text() const {
    return fmt::format("a run takes about {}, and the first trial (runs: {:.0f}) about {}", about(of_run),
                       runs, about(of_trial()));
  }
};

Plan plan_of(const search::Problem& problem, const campaign::Scenario& scenario) {
  Plan plan{campaign::time_of(scenario)};
  const auto& client = scenario.runs.front().task.client;
  const auto messages =
      static_cast<double>(client.duration.count()) / static_cast<double>(client.period.count());
  for (const auto& limit : problem.goal)
    plan.runs = std::max(plan.runs, std::ceil(search::messages_to_prove(limit, messages) / messages));
  return plan;
}

void check_time(const Arguments& arguments, const Plan& plan, Terminal& terminal) {
  const Seconds within = duration_flag("--within", arguments.within);
  if (within < plan.of_run)
    throw Error(2, fmt::format("--within {}: too short for one run: {}", arguments.within, plan.text()));
  if (within < plan.of_trial())
    terminal.note(fmt::format("--within {} is too short for a proof: {}", arguments.within, plan.text()));
  if (plan.runs > too_many_runs)
    terminal.note(fmt::format("proof takes about {:.0f} runs: make them longer (--duration)", plan.runs));
}

// What is said before the first trial: contradictions, and settings that cannot help.
void tell(const campaign::Scenario& scenario, const search::Knobs& knobs, Terminal& terminal) {
  for (const auto& text : search::contradictions(scenario.runs.front()))
    terminal.note("contradiction: " + text);
  std::map<std::string, std::vector<std::string>> by_reason;
  for (const auto& [key, why] : knobs.left_out) by_reason[why].push_back(key);
  for (const auto& [why, keys] : by_reason)
    terminal.note(fmt::format("not tried: {}: {}", fmt::join(keys, ", "), why));
}

Subject subject_of(const campaign::Scenario& scenario, const search::Problem& problem) {
  std::vector<std::string> limits, settings;
  for (const auto& limit : problem.goal) limits.push_back(limit.text);
  for (const auto& knob : problem.knobs)
    settings.push_back(knob.values.empty() ? knob.key
                                           : fmt::format("{}: {}", knob.key, fmt::join(knob.values, " or ")));
  const auto& run = scenario.runs.front();
  return {
      scenario.text, fmt::format("{}", fmt::join(limits, " and ")),
      fmt::format("{} over {}, {} s", run.id, run.task.transport, Seconds(run.task.client.duration).count()),
      fmt::format("{}", fmt::join(settings, "; "))};
}

std::string picture_beside(const std::string& results) {
  return std::filesystem::path(results).replace_extension("search.html").string();
}

int exit_code(const search::Outcome& outcome, const Trials& trials) {
  switch (outcome.end) {
    case search::End::goal_holds:
      return 0;
    case search::End::no_time:
      return trials.code();
    case search::End::cannot_measure:
      return 3;
    default:
      return 1;
  }
}

std::vector<search::Part> goal_of(const Arguments& arguments) {
  try {
    return search::goal_of(arguments.goal);
  } catch (const gate::Error& error) {
    throw Error(2, fmt::format("--goal: {}", error.what()));
  }
}

int run(const Arguments& arguments) {
  const bool as_json = is_json_flag(arguments.format);
  const auto goal = goal_of(arguments);
  const auto files = scenario_files({arguments.scenario});
  if (files.size() != 1)
    throw Error(2, fmt::format("{} are {} scenarios: name one", arguments.scenario, files.size()));
  const auto selection = arguments.choice.checked();
  const auto scenario = scenario_of(arguments, files.front(), selection, {});
  const auto bounds = bounds_of(arguments, scenario);
  const auto knobs = search::knobs_of(scenario.runs.front(), bounds);
  search::Problem problem{{}, knobs.knobs};
  for (const auto& part : goal) problem.goal.push_back(part.limit);
  const auto results = arguments.results.empty() ? new_results_file(arguments.scenario) : arguments.results;
  if (!arguments.resume && std::filesystem::exists(results))
    throw Error(
        2, fmt::format("--results: {} exists: name another file, or add --resume to go on with its search",
                       results));
  auto& interrupts = catch_interrupts();
  Terminal terminal;
  const auto plan = plan_of(problem, scenario);
  if (!arguments.resume) check_time(arguments, plan, terminal);
  tell(scenario, knobs, terminal);
  record::Writer writer(results);
  Trials trials(subject_of(scenario, problem),
                [&](const search::Set& set) { return scenario_of(arguments, files.front(), selection, set); },
                goal, bounds, Trials::Clock::now() + duration_flag("--within", arguments.within),
                {writer, terminal, interrupts});
  if (arguments.resume) trials.recall(results);
  const auto outcome =
      search::find(problem, [&](const search::Order& order) { return trials.measure(order); });
  terminal.clear_line();
  if (outcome.runs == 0) throw Error(trials.code(), trials.stopped());
  const SearchReport report{problem,
                            outcome,
                            knobs.left_out,
                            trials.stopped(),
                            arguments.scenario,
                            results,
                            picture_beside(results),
                            search::keep(scenario, outcome.set, orders::this_program())};
  Output page(report.page);
  page.write(page_of(report));
  page.finish();
  const auto reader = writer.reader();
  terminal.note("page of all runs: " + write_page_beside(results, reader, statistics::summarise(reader)));
  as_json ? print_json(json_of(report)) : print(for_output(text_of(report)));
  if (outcome.end == search::End::no_time || outcome.end == search::End::cannot_measure)
    terminal.note(fmt::format("to go on: the same command with --results {} --resume", results));
  return exit_code(outcome, trials);
}

}  // namespace

void add_tune_search(Command& tune, Action& action) {
  auto* command = tune.add_subcommand(
      "search", "Finds the smallest set of settings by which a scenario meets a goal, and proves it");
  command->footer(
      fmt::format("Each run sets what it tries, measures, and restores it. The settings found are not "
                  "applied: the output "
                  "says how to keep them.\nA search may set: {}.\nExit codes: 0 the goal holds · 1 it does "
                  "not, or is not "
                  "proven · 2 wrong usage or input · 3 this machine or a peer cannot do it · 130 interrupted",
                  fmt::join(search::knob_keys(), ", ")));
  auto arguments = std::make_shared<Arguments>();
  command->add_option("SCENARIO", arguments->scenario, "a scenario with one run between two hosts")
      ->required();
  command->add_option("--goal", arguments->goal, "such as 'p99.9 < 1 ms and response late = 0'")
      ->type_name("GOAL")
      ->required()
      ->check(given);
  command->add_option("--within", arguments->within, "stop after this time: 2 h")
      ->type_name("TIME")
      ->check(given);
  command->add_option("--never", arguments->never, "never set these (list below), such as irq-threads")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->type_name("KEY,...")
      ->check(given);
  command
      ->add_option("--below-priority", arguments->below_priority,
                   "keep threads of the kernel below this priority (default: the application's, or 80)")
      ->type_name("N")
      ->range(2, 99);
  command->add_option("--keep-cpus-off", arguments->keep_cpus_off, "put nothing on these CPUs")
      ->type_name("LIST")
      ->check(given);
  add_choice(*command, arguments->choice);
  add_file(*command, "--results", arguments->results, "a new results file (default: one here)");
  command->add_flag("--resume", arguments->resume, "go on with the search that these results hold")
      ->needs("--results");
  add_format(*command, arguments->format);
  command->callback([&action, arguments] { action = [arguments] { return run(*arguments); }; });
}

}  // namespace ontime::app

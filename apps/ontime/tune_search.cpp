// SPDX-License-Identifier: Apache-2.0
// The search for the smallest set of settings by which a scenario meets a goal.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <map>
#include <numeric>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <linux/capability.h>

#include "campaign/campaign.hpp"
#include "commands.hpp"
#include "flags.hpp"
#include "in_lab.hpp"
#include "isolation/groups.hpp"
#include "machine/machine.hpp"
#include "measured.hpp"
#include "output.hpp"
#include "realtime/privileges.hpp"
#include "realtime/realtime.hpp"
#include "scenario_files.hpp"
#include "search/goal.hpp"
#include "search_report.hpp"
#include "search_trials.hpp"
#include "spelling/spelling.hpp"
#include "table/table.hpp"
#include "terminal.hpp"

namespace ontime::app {
namespace {

using campaign::Error;
using Seconds = std::chrono::duration<double>;

constexpr const char* usual_time = "2 h";
constexpr int usual_priority = 80;
constexpr double too_many_runs = 24;  // to prove that a goal holds

struct Arguments {
  std::string scenario, goal, on = "here", within = usual_time, results, keep_cpus_off, format = "table";
  std::string send_to;  // for the search in the lab's machine, which measures and prints nothing
  std::vector<std::string> never;
  Choice choice;
  LabFlags lab;
  std::optional<int> below_priority;
  bool resume = false;
};

campaign::Scenario scenario_of(const Arguments& arguments, const std::string& file,
                               campaign::Selection selection, const search::Set& set) {
  selection.explain = true;
  selection.set = set;
  auto scenario = campaign::read_scenario(file, selection);
  if (scenario.runs.size() != 1 || scenario.hosts.components.size() != 1)
    throw wrong(
        "tune search: {} has {} and {}, but a search needs one run between two hosts. Choose with --only and "
        "--transports, and leave out lists",
        arguments.scenario, table::many(scenario.runs.size(), "run", "runs"),
        table::many(scenario.hosts.components.size(), "component", "components"));
  scenario.repeat = 1;
  return scenario;
}

// A whole key, or the last word of one or more.
void check_never(const std::string& name) {
  const auto keys = search::knob_keys();
  auto words = keys;
  for (const auto& key : keys) words.push_back(key.substr(key.rfind('.') + 1));
  if (std::ranges::find(words, name) != words.end()) return;
  const auto meant = spelling::suggestion(name, words);
  throw wrong("--never: a search does not set '{}'{}", name,
              meant.empty() ? fmt::format(". It may set: {}", fmt::join(keys, ", ")) : meant);
}

// The CPUs that settings may use: without those of --keep-cpus-off.
std::vector<int> cpus_of(const Arguments& arguments, std::vector<int> cpus) {
  if (arguments.keep_cpus_off.empty()) return cpus;
  const auto there = realtime::list_of(cpus);
  const auto off = realtime::cpus_of(arguments.keep_cpus_off);
  if (!off)
    throw wrong("--keep-cpus-off: '{}' is not a CPU list, such as 0 or 0-1,3. CPUs here: {}",
                arguments.keep_cpus_off, there);
  for (const int cpu : *off)
    if (std::erase(cpus, cpu) == 0) throw wrong("--keep-cpus-off: no CPU {} here. CPUs here: {}", cpu, there);
  if (cpus.empty())
    throw wrong("--keep-cpus-off: {} leaves no CPU. CPUs here: {}", arguments.keep_cpus_off, there);
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
  return bounds;
}

// The checked arguments. Reads no machine.
struct Asked {
  std::vector<search::Part> goal;
  std::string file;
  campaign::Selection selection;
  campaign::Scenario scenario;
  search::Bounds bounds;
  std::string results;
  Seconds within;
};

// The least time of a search, from its first trial.
struct Plan {
  Seconds of_run{0};
  double runs = 1;  // of the first trial: to prove that the goal holds, where it does

  Seconds of_trial() const { return of_run * runs; }
  std::string text() const {
    return fmt::format("a run takes about {}, and the first trial (runs: {:.0f}) about {}", about(of_run),
                       runs, about(of_trial()));
  }
};

Plan plan_of(const Asked& asked) {
  Plan plan{campaign::time_of(asked.scenario)};
  const auto& client = asked.scenario.runs.front().task.client;
  const auto messages =
      static_cast<double>(client.duration.count()) / static_cast<double>(client.period.count());
  for (const auto& part : asked.goal)
    plan.runs = std::max(plan.runs, std::ceil(search::messages_to_prove(part.limit, messages) / messages));
  return plan;
}

void check_time(const Arguments& arguments, Seconds within, const Plan& plan) {
  if (within < plan.of_run)
    throw wrong("--within {}: too short for one run: {}", arguments.within, plan.text());
  if (within < plan.of_trial())
    print_error(fmt::format("--within {} is too short for a proof: {}", arguments.within, plan.text()));
  if (plan.runs > too_many_runs)
    print_error(fmt::format("a proof takes about {:.0f} runs: use longer runs (--duration)", plan.runs));
}

// Each run records kernel events: on this machine that is denied to an ordinary user.
void check_user(const campaign::Hosts& hosts) {
  const auto is_of_this_user = [](const campaign::Host& host) {
    return host.ssh.empty() && host.host_prefix.empty() && host.command_prefix.empty() &&
           host.program.empty();
  };
  const bool is_denied = !realtime::privileges().has(CAP_SYS_ADMIN);
  if (is_denied && (is_of_this_user(hosts.controller) || is_of_this_user(hosts.components.front().host)))
    throw Error(3, "tune search records kernel events in each run, which is denied on this machine. Fix: " +
                       campaign::as_root());
}

// Notes before the first trial: contradictions, and settings that are not tried.
void tell(const campaign::Scenario& scenario, const search::Knobs& knobs) {
  for (const auto& [key, notice] : scenario.notices) print_error(notice);
  for (const auto& text : search::contradictions(scenario.runs.front()))
    print_error("contradiction: " + text);
  std::map<std::string, std::vector<std::string>> by_reason;
  for (const auto& [key, why] : knobs.left_out) by_reason[why].push_back(key);
  for (const auto& [why, keys] : by_reason)
    print_error(fmt::format("not tried: {}: {}", fmt::join(keys, ", "), why));
}

Subject subject_of(const campaign::Scenario& scenario, const search::Problem& problem,
                   const std::string& machine, const record::ByName<record::Machine>& machines) {
  std::vector<std::string> settings;
  for (const auto& knob : problem.knobs)
    settings.push_back(knob.values.empty() ? knob.key
                                           : fmt::format("{}: {}", knob.key, fmt::join(knob.values, " or ")));
  const auto& run = scenario.runs.front();
  return {
      scenario.text,
      goal_of(problem),
      fmt::format("{} over {}, {} s", run.id, run.task.transport, Seconds(run.task.client.duration).count()),
      fmt::format("{}", fmt::join(settings, "; ")),
      machine,
      machines};
}

Asked asked_of(const Arguments& arguments) {
  Asked asked;
  asked.goal = read_flag("--goal", [&] { return search::goal_of(arguments.goal); });
  const auto files = scenario_files({arguments.scenario});
  if (files.size() != 1) throw wrong("{} has {} scenarios: name one", arguments.scenario, files.size());
  asked.file = files.front();
  asked.selection = arguments.choice.checked();
  asked.scenario = scenario_of(arguments, asked.file, asked.selection, {});
  asked.bounds = bounds_of(arguments, asked.scenario);
  asked.results = arguments.results.empty() ? new_results_file(arguments.scenario) : arguments.results;
  asked.within = duration_flag("--within", arguments.within);
  return asked;
}

search::Problem problem_of(const Asked& asked, const search::Knobs& knobs) {
  search::Problem problem{{}, knobs.knobs};
  for (const auto& part : asked.goal) problem.goal.push_back(part.limit);
  return problem;
}

// The runs of a search, made or recalled, and what comes of them.
class Searched {
 public:
  Searched(const Arguments& arguments, const Asked& asked, const search::Knobs& knobs,
           const std::string& machine, const record::ByName<record::Machine>& machines,
           const Trials::Places& places)
      : arguments_(arguments),
        asked_(asked),
        knobs_(knobs),
        problem_(problem_of(asked, knobs)),
        places_(places),
        trials_(
            subject_of(asked.scenario, problem_, machine, machines),
            [&](const search::Set& set) { return scenario_of(arguments, asked.file, asked.selection, set); },
            asked.goal, asked.bounds,
            Trials::Clock::now() + std::chrono::duration_cast<Trials::Clock::duration>(asked.within),
            places) {}

  void recall() { trials_.recall(asked_.results); }
  // Recalls all runs; the search then ends for this reason, with this exit code.
  void recall(const std::string& why, int code) {
    recall();
    trials_.end(why, code);
  }
  const search::Outcome& find() {
    return outcome_ = search::find(problem_, [this](const auto& order) { return trials_.measure(order); });
  }
  int exit_code() const {
    return outcome_.end == search::End::goal_holds       ? 0
           : outcome_.end == search::End::no_time        ? trials_.code()
           : outcome_.end == search::End::cannot_measure ? 3
                                                         : 1;
  }
  const std::string& stopped() const { return trials_.stopped(); }
  // On standard output, and as pages beside the results. Returns the exit code.
  int show(const search::Places& = {{"", {{}, orders::this_program()}}}) const;

 private:
  const Arguments& arguments_;
  const Asked& asked_;
  const search::Knobs knobs_;
  const search::Problem problem_;
  const Trials::Places places_;
  Trials trials_;
  search::Outcome outcome_;
};

int Searched::show(const search::Places& places) const {
  const bool as_json = is_json_flag(arguments_.format);
  const auto& results = asked_.results;
  const auto reader = places_.writer.reader();
  places_.terminal.does("drawing the pages");
  const SearchReport report{problem_,
                            outcome_,
                            knobs_.left_out,
                            stopped(),
                            machine_of(reader),
                            arguments_.scenario,
                            results,
                            std::filesystem::path(results).replace_extension("search.html").string(),
                            search::keep(asked_.scenario.runs.front(), outcome_.set, places)};
  write_whole(report.page, page_of(report), Kind::page);
  print_error("page of all runs: " + write_page_beside(results, reader, statistics::summarise(reader)));
  as_json ? print_json(json_of(report)) : print(text_of(report));
  if (outcome_.end == search::End::no_time || outcome_.end == search::End::cannot_measure)
    print_error("to continue: " + to_go_on(results, !arguments_.results.empty(), arguments_.resume));
  return exit_code();
}

int search_here(const Arguments& arguments, Asked asked, Terminal& terminal,
                campaign::Interrupts& interrupts) {
  record::Writer writer(asked.results);
  search::Knobs knobs;
  search::Places places;
  record::ByName<record::Machine> machines;
  {
    const campaign::Look look(asked.scenario, terminal, interrupts);
    if (look.most_cpus() == 1) asked.bounds.cpus.clear();
    auto bounds = asked.bounds;
    bounds.cannot = [&](const search::Setting& one) { return look.why_not(one.key, one.value); };
    knobs = search::knobs_of(asked.scenario.runs.front(), bounds);
    for (const auto& [host, place] : look.places()) places[host] = {place.link, place.program, !place.by_ssh};
    machines = look.machines();
  }
  tell(asked.scenario, knobs);
  Trials::Places trials{writer, terminal, interrupts};
  if (!arguments.send_to.empty())
    trials.counts = [&](std::int64_t run) { send_from_lab(writer, run, arguments.send_to); };
  const auto simulated = machine::describe().at("simulated");
  Searched searched(arguments, asked, knobs, simulated.is_string() ? simulated.get<std::string>() : "",
                    machines, trials);
  if (arguments.resume) searched.recall();
  if (searched.find().runs == 0) throw Error(searched.exit_code(), searched.stopped());
  if (arguments.send_to.empty()) return searched.show(places);
  if (const auto& why = searched.stopped(); !why.empty()) terminal.note(why);
  return searched.exit_code();
}

// The search that `search_here` made in the lab's machine, from the runs in the results, which also store the
// settings that its machine can have.
Searched recalled(const Arguments& arguments, const Asked& asked, const Trials::Places& places) {
  const auto reader = places.writer.reader();
  auto bounds = asked.bounds;
  bounds.cannot = [recorded = settings_of(reader)](const search::Setting& one) {
    return is_among(recorded, one) ? "" : "not possible in the lab's machine";
  };
  const auto machine = machine_of(reader);
  return {arguments,
          asked,
          search::knobs_of(asked.scenario.runs.front(), bounds),
          machine.empty() ? "QEMU" : machine,
          {},
          places};
}

std::string reason_of(const LabEnd& end) {
  constexpr std::string_view own = "ontime: ";
  if (end.code == 130) return "interrupted";
  if (!end.unfinished.empty()) return end.unfinished;
  return end.said.starts_with(own) ? end.said.substr(own.size()) : end.said;
}

std::vector<std::string> flags_of(const Arguments& arguments) {
  std::vector<std::string> words = {"--goal", arguments.goal, "--within", arguments.within};
  if (!arguments.never.empty())
    words.insert(words.end(), {"--never", fmt::format("{}", fmt::join(arguments.never, ","))});
  if (arguments.below_priority)
    words.insert(words.end(), {"--below-priority", std::to_string(*arguments.below_priority)});
  if (!arguments.keep_cpus_off.empty())
    words.insert(words.end(), {"--keep-cpus-off", arguments.keep_cpus_off});
  return words;
}

// A shell that a signal ended exits with 128 plus the signal.
int exit_code_of(const LabEnd& end) {
  return end.code == 0 || (end.code > 3 && end.code != 130) ? 3 : end.code;
}

// The lab's machine makes the whole search. Here the runs that arrived are replayed, with the same result.
int search_in_lab(const Arguments& arguments, const Asked& asked, InLab& lab, Terminal& terminal,
                  campaign::Interrupts& interrupts) {
  record::Writer writer(asked.results);
  const Trials::Places places{writer, terminal, interrupts};
  if (arguments.resume) {
    auto known = recalled(arguments, asked, places);
    known.recall("", 0);
    if (known.find().end != search::End::no_time) return known.show();
  }
  const auto end = lab.measure(writer, terminal, interrupts);
  auto searched = recalled(arguments, asked, places);
  searched.recall(reason_of(end), exit_code_of(end));
  return searched.find().runs == 0 ? exit_code_of(end) : searched.show();
}

int run(const Arguments& arguments) {
  is_json_flag(arguments.format);
  auto asked = asked_of(arguments);
  const bool is_in_lab = word_flag<bool>("--on", arguments.on, {{"here", false}, {"lab", true}});
  if (const auto flag = arguments.lab.first_given(); !is_in_lab && !flag.empty())
    throw wrong("{} applies to the lab's machine: add --on lab, or leave it out", flag);
  if (is_in_lab && !arguments.choice.selection.cable.empty())
    throw wrong("--cable does not apply to the lab's machine: leave it out");
  std::optional<InLab> lab;
  if (is_in_lab) {
    const auto machine = arguments.lab.machine();
    std::vector<int> cpus(static_cast<std::size_t>(machine.cpus));
    std::iota(cpus.begin(), cpus.end(), 0);
    asked.bounds.cpus = cpus_of(arguments, cpus);
    if (machine.cpus == 1) asked.bounds.cpus.clear();
    lab.emplace(machine, LabTask{{"ontime", "tune", "search"},
                                 {asked.file},
                                 arguments.choice,
                                 arguments.resume,
                                 flags_of(arguments)});
  } else {
    if (!arguments.resume) check_user(asked.scenario.hosts);
    asked.bounds.cpus = cpus_of(arguments, isolation::cpus_of_thread(getpid()));
  }
  check_results(asked.results, arguments.resume);
  auto& interrupts = catch_interrupts("interrupted: restoring settings …");
  Terminal terminal;
  if (!arguments.resume && arguments.send_to.empty()) check_time(arguments, asked.within, plan_of(asked));
  try {
    return lab ? search_in_lab(arguments, asked, *lab, terminal, interrupts)
               : search_here(arguments, asked, terminal, interrupts);
  } catch (const orders::Interrupted&) {  // before the first run
    return 130;
  }
}

}  // namespace

void add_tune_search(Command& tune) {
  auto* command = tune.add_subcommand(
      "search", "Finds the smallest set of settings by which a scenario meets a goal, and proves it");
  command->footer(fmt::format(
      "Each run sets what it tries, measures, and restores it. The search keeps no settings: its output "
      "shows how to keep them.\nA search may set: {}.\n\nExit codes: 0 the goal holds · 1 it does not, or is "
      "not proven · 2 invalid usage or input · 3 this machine or a peer cannot do it · 130 interrupted",
      fmt::join(search::knob_keys(), ", ")));
  auto arguments = std::make_shared<Arguments>();
  command->add_option("SCENARIO", arguments->scenario, "a scenario with one run between two hosts")
      ->required();
  add_value(*command, "--goal", arguments->goal, "GOAL", "such as 'p99.9 < 1 ms and response late = 0'")
      ->required();
  add_value(*command, "--within", arguments->within, "TIME", "stop after this time (default: 2 h)");
  add_list(*command, "--never", arguments->never, "KEY,...",
           "never set these (list below), such as irq-threads");
  command
      ->add_option("--below-priority", arguments->below_priority,
                   "keep threads of the kernel below this priority (default: the application's, or 80)", "N")
      ->range(2, 99);
  add_value(*command, "--keep-cpus-off", arguments->keep_cpus_off, "LIST",
            "move no threads or interrupts to these CPUs");
  add_value(
      *command, "--on", arguments->on, "here|lab",
      "measure on this machine and the scenario's hosts, or in the lab's simulated machine (default: here)");
  add_choice(*command, arguments->choice);
  add_cable(*command, arguments->choice);
  add_results(*command, arguments->results,
              "results file; with --resume the one to continue (default: a new one here)");
  command->add_flag("--resume", arguments->resume, "continue the search in the results file")
      ->needs("--results");
  add_format(*command, arguments->format);
  arguments->lab.add(*command, "With --on lab");
  command->add_option("--send-to", arguments->send_to, "send each run that counts; print nothing")->group("");
  command->calls([arguments] { return run(*arguments); });
}

}  // namespace ontime::app

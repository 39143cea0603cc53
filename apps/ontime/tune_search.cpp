// SPDX-License-Identifier: Apache-2.0
// The search for the smallest set of settings by which a scenario meets a goal: its runs are carried out
// here, as those of `ontime run` are. The results file is its only memory: of the runs in it, in their order,
// the search makes the same way again, and goes on from there.
#include <algorithm>
#include <chrono>
#include <deque>
#include <filesystem>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "campaign/campaign.hpp"
#include "commands.hpp"
#include "explain/explain.hpp"
#include "flags.hpp"
#include "gate/gate.hpp"
#include "isolation/groups.hpp"
#include "keeper/keeper.hpp"
#include "measured.hpp"
#include "output.hpp"
#include "results_page.hpp"
#include "scenario_files.hpp"
#include "search/goal.hpp"
#include "search_report.hpp"
#include "settings/settings.hpp"
#include "terminal.hpp"

namespace ontime::app {
namespace {

using campaign::Error;
using Clock = std::chrono::steady_clock;

constexpr const char* note_kind = "search";
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

bool is_here(const campaign::Host& host) { return host.ssh.empty() && host.reach.empty(); }

// Settings that this machine is known to lack: all hosts are on it.
std::map<std::string, std::string> lacks_of(const campaign::Scenario& scenario) {
  std::map<std::string, std::string> cannot;
  const auto& hosts = scenario.hosts;
  if (!is_here(hosts.controller) || !is_here(hosts.components.front().host)) return cannot;
  const bool is_virtual =
      hosts.kind == campaign::Hosts::Kind::namespaces && hosts.controller.interface.empty();
  for (const auto& state : settings::show({})) {
    const auto key = fmt::format("kernel.{}", state.setting->name);
    if (!state.setting->of_interface && !state.cannot.empty()) cannot[key] = state.cannot;
  }
  if (is_virtual)
    for (const auto* name : {"irq-cpus", "irq-threads", "coalescing"})
      cannot[fmt::format("kernel.{}", name)] =
          "the namespaces' interfaces are virtual, and have no interrupts";
  return cannot;
}

search::Bounds bounds_of(const Arguments& arguments, const campaign::Scenario& scenario) {
  search::Bounds bounds;
  for (const auto& name : arguments.never) {
    const auto& keys = campaign::keys();
    if (std::none_of(keys.begin(), keys.end(),
                     [&](const auto& key) { return key.path == name || key.path.ends_with("." + name); }))
      throw Error(
          2, fmt::format("--never: there is no setting '{}'; take a key of scenarios, such as irq-threads or "
                         "realtime.lock-memory",
                         name));
    bounds.never.insert(name);
  }
  const int own = campaign::application_priority(scenario.runs.front());
  bounds.below_priority = arguments.below_priority.value_or(own > 0 ? own : usual_priority);
  std::vector<int> off;
  if (!arguments.keep_cpus_off.empty()) {
    const auto cpus = realtime::cpus_of(arguments.keep_cpus_off);
    if (!cpus)
      throw Error(2, fmt::format("--keep-cpus-off: '{}' is no list of CPUs such as 0 or 0-1,3",
                                 arguments.keep_cpus_off));
    off = *cpus;
  }
  for (const int cpu : isolation::cpus_of_thread(getpid()))  // a container may permit fewer than there are
    if (std::find(off.begin(), off.end(), cpu) == off.end()) bounds.cpus.push_back(cpu);
  bounds.cannot = lacks_of(scenario);
  return bounds;
}

// What is said before the first trial: contradictions, settings that cannot help, and runs that are too
// short.
void check(const search::Problem& problem, const campaign::Scenario& scenario, const search::Knobs& knobs,
           Terminal& terminal) {
  const auto& run = scenario.runs.front();
  for (const auto& text : search::contradictions(run)) terminal.note("contradiction: " + text);
  for (const auto& [key, why] : knobs.left_out) terminal.note(fmt::format("not tried: {}: {}", key, why));
  const auto messages = static_cast<double>(run.task.client.duration.count()) /
                        static_cast<double>(run.task.client.period.count());
  for (const auto& limit : problem.goal)
    if (const auto needed = 6 / std::max(limit.share, 1 / messages) / messages; needed > too_many_runs)
      terminal.note(fmt::format("{}: proof takes about {:.0f} runs of {:.0f} messages: make the runs longer",
                                limit.text, needed, messages));
}

class Trials {
 public:
  Trials(const Arguments& arguments, std::string file, const std::vector<search::Part>& goal,
         const search::Bounds& bounds, record::Writer& writer, Terminal& terminal,
         campaign::Interrupts& interrupts)
      : arguments_(arguments),
        selection_(arguments.choice.checked()),
        file_(std::move(file)),
        goal_(goal),
        bounds_(bounds),
        writer_(writer),
        terminal_(terminal),
        interrupts_(interrupts),
        until_(Clock::now() + duration_flag("--within", arguments.within)) {
    if (arguments.resume) recall();
  }

  std::optional<search::Answer> measure(const search::Order& order) {
    if (!stopped_.empty()) return {};
    try {
      const auto scenario = scenario_of(arguments_, file_, selection_, order.set);
      if (auto known = recalled(order, scenario)) return recalled_answer(*known);
      if (Clock::now() + std::chrono::duration_cast<Clock::duration>(campaign::time_of(scenario)) > until_)
        return stop(fmt::format("{} are over (--within)", arguments_.within), 1);
      return measured(order, scenario);
    } catch (const scenario::Error& error) {  // its keys contradict one another
      return search::Answer{{}, {}, error.what()};
    } catch (const campaign::Error& error) {
      return stop(error.what(), error.exit);
    }
  }

  const std::string& stopped() const { return stopped_; }
  int code() const { return code_; }

 private:
  static std::string text_of(const search::Order& order) {
    return fmt::format("search, trial {}, run {}: {}", order.trial, order.number, words_of(order.set));
  }

  std::nullopt_t stop(const std::string& why, int code) {
    stopped_ = why;
    code_ = code;
    return std::nullopt;
  }

  // The runs of this search that the results have.
  void recall() {
    const auto reader = writer_.reader();
    for (auto& run : reader.runs())
      for (const auto& note : reader.notes(run.number))
        if (note.kind == note_kind) {
          known_.push_back({note.text, std::move(run)});
          break;
        }
  }

  std::optional<record::Run> recalled(const search::Order& order, const campaign::Scenario& scenario) {
    if (known_.empty()) return {};
    auto [text, run] = std::move(known_.front());
    known_.pop_front();
    if (text != text_of(order) || record::at(run.asked.document, "scenario") != scenario.text)
      throw Error(
          2, fmt::format("--resume: run {} of {} is '{}', and this search comes to '{}' there: its goal, its "
                         "bounds or the scenario changed. Begin a new file of results",
                         run.number, arguments_.results, text, text_of(order)));
    return run;
  }

  std::optional<search::Answer> measured(const search::Order& order, const campaign::Scenario& scenario) {
    terminal_.note(text_of(order));
    const auto before = last_number();
    const int code = campaign::execute(scenario, writer_, terminal_, interrupts_, command_line());
    if (code == 130 || interrupts_ > 0) return stop("interrupted", 130);
    const auto number = last_number();
    if (number == before) return stop("no run was measured", 3);
    const auto run = writer_.reader().runs(number).front();
    if (const auto text = changed_by_another(run); !text.empty()) return stop(text, 3);
    writer_.note(number, {note_kind, text_of(order), {}, {}});
    writer_.flush();
    return answer_of(run);
  }

  std::int64_t last_number() {
    const auto runs = writer_.reader().runs();
    return runs.empty() ? 0 : runs.back().number;
  }

  search::Answer recalled_answer(const record::Run& run) {
    auto answer = answer_of(run);
    answer.is_recalled = true;
    return answer;
  }

  search::Answer answer_of(const record::Run& run) {
    const auto reader = writer_.reader();
    const auto summary = statistics::summarise(reader, run);
    search::Answer answer;
    answer.refused = gate::unfit(summary);
    if (!answer.refused.empty()) return answer;
    std::int64_t slow_ns = 0;
    for (const auto& part : goal_) {
      answer.tallies.push_back(search::tally_of(part, summary));
      const bool is_time =
          part.gate.figure != statistics::Figure::late && part.gate.figure != statistics::Figure::lost;
      const auto limit_ns = static_cast<std::int64_t>(part.gate.limit);
      if (is_time) slow_ns = slow_ns == 0 ? limit_ns : std::min(slow_ns, limit_ns);
    }
    answer.findings = search::findings_of(explain::account_of(reader, run), run, slow_ns, bounds_);
    return answer;
  }

  // What a run set stays so until it gives it back, unless another process changes it.
  static std::string changed_by_another(const record::Run& run) {
    for (const auto& [name, host] : run.outcome.hosts)
      for (const auto& change : host.kernel)
        if (!change.lasted())
          return fmt::format(
              "another process changed {} ({}) on the {} from {} to {}: it stays so, and the search steps "
              "back. "
              "Stop that process, and search again",
              change.setting, change.thing, name, change.after.dump(), change.now.dump());
    return "";
  }

  const Arguments& arguments_;
  const campaign::Selection selection_;
  const std::string file_;
  const std::vector<search::Part>& goal_;
  const search::Bounds& bounds_;
  record::Writer& writer_;
  Terminal& terminal_;
  campaign::Interrupts& interrupts_;
  const Clock::time_point until_;
  struct Known {
    std::string text;
    record::Run run;
  };
  std::deque<Known> known_;
  std::string stopped_;
  int code_ = 0;
};

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

int run(const Arguments& arguments) {
  const bool as_json = is_json_flag(arguments.format);
  std::vector<search::Part> goal;
  try {
    goal = search::goal_of(arguments.goal);
  } catch (const gate::Error& error) {
    throw Error(2, fmt::format("--goal: {}", error.what()));
  }
  const auto files = scenario_files({arguments.scenario});
  if (files.size() != 1)
    throw Error(2, fmt::format("{} are {} scenarios: name one", arguments.scenario, files.size()));
  const auto scenario = scenario_of(arguments, files.front(), arguments.choice.checked(), {});
  const auto bounds = bounds_of(arguments, scenario);
  const auto knobs = search::knobs_of(scenario.runs.front(), bounds);
  search::Problem problem{{}, knobs.knobs};
  for (const auto& part : goal) problem.goal.push_back(part.limit);
  const auto results = arguments.results.empty() ? new_results_file(arguments.scenario) : arguments.results;
  if (!arguments.resume && std::filesystem::exists(results))
    throw Error(
        2,
        fmt::format("--results: {} is there already: name another, or add --resume to go on with its search",
                    results));
  auto& interrupts = catch_interrupts();
  Terminal terminal;
  check(problem, scenario, knobs, terminal);
  record::Writer writer(results);
  Trials trials(arguments, files.front(), goal, bounds, writer, terminal, interrupts);
  const auto outcome =
      search::find(problem, [&](const search::Order& order) { return trials.measure(order); });
  terminal.clear_line();
  if (outcome.runs == 0) throw Error(trials.code(), trials.stopped());
  SearchReport report{problem,
                      outcome,
                      knobs.left_out,
                      trials.stopped(),
                      arguments.scenario,
                      results,
                      picture_beside(results)};
  Output page(report.page);
  page.write(page_of(report));
  page.finish();
  const auto reader = writer.reader();
  terminal.note("page of all runs: " + write_page_beside(results, reader, statistics::summarise(reader)));
  as_json ? print_json(json_of(report)) : print(for_output(text_of(report)));
  if (outcome.end == search::End::no_time)
    terminal.note(fmt::format("to go on: the same command with --results {} --resume", results));
  return exit_code(outcome, trials);
}

}  // namespace

void add_tune_search(Command& tune, Action& action) {
  auto* command = tune.add_subcommand(
      "search", "Finds the smallest set of settings by which a scenario meets a goal, and proves it");
  command->footer(
      "Each run sets what it tries, measures, and gives it back. The settings found stay in no place: the "
      "output "
      "says how to keep them.\nExit codes: 0 the goal holds · 1 it does not, or is not proven · 3 this "
      "machine or a "
      "peer cannot do it");
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
  command->add_option("--never", arguments->never, "never set these, such as irq-threads")
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

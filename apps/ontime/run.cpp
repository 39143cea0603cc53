// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <ctime>
#include <filesystem>
#include <span>

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include "campaign/campaign.hpp"
#include "commands.hpp"
#include "flags.hpp"
#include "gates.hpp"
#include "results_page.hpp"
#include "resumed.hpp"
#include "scenario_files.hpp"
#include "terminal.hpp"

namespace ontime::app {
namespace {

struct Arguments {
  std::vector<std::string> scenarios;
  campaign::Selection selection;
  std::string duration, results, format = "table";
  bool resume = false;
};

// Beside the user, named after what was run and when; an earlier one is never added to.
std::string new_results_file(const std::string& scenario) {
  auto path = std::filesystem::path(scenario).lexically_normal();
  if (!path.has_filename()) path = path.parent_path();  // "paper/"
  const auto stem =
      fmt::format("{}-{:%Y%m%d-%H%M%S}", path.stem().string(), fmt::localtime(std::time(nullptr)));
  auto name = stem + ".ontime";
  for (int next = 2; exists(std::filesystem::symlink_status(name)); ++next)
    name = fmt::format("{}-{}.ontime", stem, next);
  return name;
}

// A slip of the pen in what was asked for by name must not show only after hours. (A transport that a
// scenario lists and this machine lacks costs its own runs only.)
void check_transports(const std::vector<std::string>& names) {
  const auto here = transport::available();
  for (const auto& name : names)
    if (std::find(here.begin(), here.end(), name) == here.end())
      throw campaign::Error(3, fmt::format("--transports: there is no transport '{}' here; there are: {}",
                                           name, fmt::join(here, ", ")));
}

void expect(Terminal& terminal, const std::vector<campaign::Scenario>& scenarios) {
  std::size_t runs = 0;
  std::chrono::duration<double> time{0};
  for (const auto& scenario : scenarios) {
    runs += scenario.size();
    time += campaign::time_of(scenario);
  }
  terminal.expect(runs, time);
  if (runs > 1) terminal.note(fmt::format("{} runs, about {}", runs, about(time)));
}

// Once, however often the runs are resumed.
void note(record::Writer& writer, statistics::Summary& summary, const gate::Judgement& judgement) {
  const bool missed = judgement.result == gate::Judgement::Result::missed;
  const auto text =
      fmt::format("{}: {}: {}", gate::word_of(judgement.result), judgement.gate, judgement.says);
  const bool known = std::any_of(summary.notes.begin(), summary.notes.end(),
                                 [&](const auto& before) { return before.text == text; });
  if (known) return;
  summary.notes.push_back({missed ? "gate-missed" : "gate-not-judged", text, {}, {}});
  writer.note(summary.run.number, summary.notes.back());
}

// Of these runs, by what their scenario and the flags say: what does not hold goes into the file too.
std::vector<gate::Judgement> judge(record::Writer& writer, std::span<statistics::Summary> summaries,
                                   const GateFlags& flags, const std::vector<gate::Gate>& gates) {
  std::vector<gate::Judgement> judgements;
  for (auto& summary : summaries) {
    for (auto& judgement : flags.judge(gates, summary)) {
      if (judgement.result != gate::Judgement::Result::held && judgement.gate != gate::end)
        note(writer, summary, judgement);
      judgements.push_back(std::move(judgement));
    }
  }
  return judgements;
}

// For people; what is asked for as JSON or CSV is nothing else.
void explain_new(record::Writer& writer, std::size_t known, report::Format format) {
  if (format != report::Format::table && format != report::Format::markdown) return;
  const auto reader = writer.reader();
  const auto runs = reader.runs();
  std::vector<report::Explained> all;
  for (std::size_t i = known; i < runs.size(); ++i)
    if (auto account = explain::account_of(reader, runs[i]); account.traced)
      all.push_back({runs[i], std::move(account)});
  if (!all.empty()) print("\n" + report::render_explained(all, format));
}

int run(const Arguments& arguments, const GateFlags& flags, const nlohmann::json& command_line) {
  auto selection = arguments.selection;
  if (!arguments.duration.empty()) selection.duration = duration_flag("--duration", arguments.duration);
  const auto format = format_flag(arguments.format);
  const auto gates = flags.gates();
  check_transports(selection.transports);
  std::vector<campaign::Scenario> scenarios;  // all read before the first is run
  for (const auto& name : arguments.scenarios)
    for (const auto& file : scenario_files(name))
      scenarios.push_back(campaign::read_scenario(file, selection));

  const auto results =
      arguments.results.empty() ? new_results_file(arguments.scenarios.front()) : arguments.results;
  auto& interrupts = catch_interrupts();
  record::Writer writer(results);
  const auto known = arguments.resume ? 0 : writer.reader().runs().size();
  const auto resumed = arguments.resume ? std::make_optional<Resumed>(writer.reader()) : std::nullopt;
  campaign::Done done;
  if (resumed) done = [&](const auto& asked, const auto& machines) { return resumed->has(asked, machines); };
  Terminal terminal;
  expect(terminal, scenarios);
  int code = 0;
  for (const auto& scenario : scenarios)
    if (code != 130)
      code = std::max(code, campaign::execute(scenario, writer, terminal, interrupts, command_line, done));
  terminal.clear_line();
  auto summaries = statistics::summarise(writer.reader());
  if (summaries.empty()) return code;  // interrupted before the first
  const auto judgements = judge(writer, std::span(summaries).subspan(known), flags, gates);
  const std::vector<statistics::Summary> fresh(summaries.begin() + static_cast<std::ptrdiff_t>(known),
                                               summaries.end());
  print(report::render(fresh, format));
  explain_new(writer, known, format);
  terminal.note(fmt::format("every sample is in {}; see also: ontime report {} --threads", results, results));
  try {
    terminal.note(fmt::format("to look at: {}", write_page_beside(results, writer.reader(), summaries)));
  } catch (const std::exception& error) {  // what was measured is safe, and said
    terminal.note(fmt::format("there is no page of it: {}", error.what()));
  }
  const int judged = flags.finish(judgements, results);
  terminal.note(report::verdict(fresh));  // the last line is what is read first
  return code == 130 ? code : std::max(code, judged);
}

}  // namespace

void add_run(CLI::App& app, Action& action) {
  auto* command = app.add_subcommand(
      "run",
      "Carries out scenarios: hosts, settings, load, round trips, the table, and a page beside the results");
  command->footer(
      "A scenario is code: under hosts it names programs, which run here, and its options may name files. "
      "Read "
      "one of somebody else's before you run it.");
  auto arguments = std::make_shared<Arguments>();
  command
      ->add_option("SCENARIO", arguments->scenarios,
                   "scenario files, folders of them, or names that `ontime scenarios` shows")
      ->required();
  command->add_option("--only", arguments->selection.only, "only these runs")
      ->delimiter(',')
      ->type_name("ID,...")
      ->check(given);
  command
      ->add_option("--transports", arguments->selection.transports, "these, instead of those of the scenario")
      ->delimiter(',')
      ->type_name("NAME,...")
      ->check(given);
  command->add_option("--duration", arguments->duration, "of each run, instead of the scenario's")
      ->type_name("TIME")
      ->check(given);
  command->add_flag("--deploy", arguments->selection.deploy,
                    "bring this program to hosts that are reached by ssh, for the time of the run");
  command->add_flag(
      "--explain", arguments->selection.explain,
      "keep what the kernels did around late, lost and the worst messages, for `ontime explain`");
  add_file(*command, "--results", arguments->results, "add to this results file (default: a new one here)");
  command
      ->add_flag("--resume", arguments->resume,
                 "leave out what these results have already, measured to its end: the same conditions, "
                 "repetition and text of the scenario")
      ->needs("--results");
  add_report_format(*command, arguments->format);
  auto flags = std::make_shared<GateFlags>(*command, gate::Use::fail_if);
  command->callback([&action, arguments, flags] {
    action = [arguments, flags] { return run(*arguments, *flags, command_line()); };
  });
}

}  // namespace ontime::app

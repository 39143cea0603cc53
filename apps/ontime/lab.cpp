// SPDX-License-Identifier: Apache-2.0
#include "lab/lab.hpp"

#include <fmt/format.h>

#include "commands.hpp"
#include "flags.hpp"
#include "in_lab.hpp"
#include "keeper/keeper.hpp"
#include "measured.hpp"
#include "scenario_files.hpp"
#include "terminal.hpp"

namespace ontime::app {
namespace {

struct LabArguments {
  std::vector<std::string> scenarios;
  Choice choice;
  LabFlags machine;
  std::string results, format = "table";
  bool full = false, resume = false;
};

int run(const LabArguments& arguments, const GateFlags& flags) {
  const auto format = format_flag(arguments.format);
  const auto gates = flags.gates();
  const auto scenarios = scenario_files(arguments.scenarios);
  InLab lab(arguments.machine.machine(),
            {{"ontime", "run", "--only-measure"}, scenarios, arguments.choice, arguments.resume});
  const auto results =
      arguments.results.empty() ? new_results_file(arguments.scenarios.front()) : arguments.results;
  check_results(results, arguments.resume);
  auto& interrupts = catch_interrupts();
  Terminal terminal;
  flags.begin_junit();
  record::Writer writer(results);
  const auto before = writer.reader().runs().size();
  const auto end = lab.measure(writer, terminal, interrupts);
  // With --resume the report is of all runs, unless none could be measured.
  const bool none = end.code != 0 && writer.reader().runs().size() == before;
  const auto known = arguments.resume && !none ? 0 : before;
  const bool has_more = !end.unfinished.empty() && !writer.reader().runs().empty();
  const auto go_on = has_more ? to_go_on(results, !arguments.results.empty(), arguments.resume) : "";
  return show_measured({writer, results, known, end.code, end.unfinished, go_on}, format, arguments.full,
                       flags, gates, terminal);
}

int shell(const LabFlags& flags) {
  const auto machine = flags.machine();
  auto& interrupts = catch_interrupts();
  Terminal terminal;
  for (const auto& line : journal::revert_abandoned(keeper::kinds())) terminal.note(line);
  journal::Journal journal(keeper::kinds());
  terminal.note("the machine boots in about 10 to 30 s. To leave it: exit, or Ctrl-A X");
  lab::shell(machine, journal, observer_of(terminal, interrupts));
  return 0;
}

}  // namespace

void add_lab(Command& app) {
  auto* command = app.add_subcommand(
      "lab", "Runs scenarios in a simulated PREEMPT_RT machine, where they repeat exactly");
  command->require_subcommand();
  command->footer(fmt::format(
      "The machine is QEMU with two NICs and a Debian kernel, which apt downloads (70 MB) and ontime unpacks "
      "in your cache folder (400 MB; 500 MB meanwhile). Use it to compare settings. Its times are not those "
      "of a real machine.\n\n{}",
      exit_codes));
  auto* runs = command->add_subcommand(
      "run", "Runs scenarios with hosts: namespaces in the machine, and copies the results out");
  auto measured = std::make_shared<LabArguments>();
  runs->add_option("SCENARIO", measured->scenarios,
                   "scenario files, folders, or names that `ontime scenarios` lists")
      ->required();
  measured->machine.add(*runs);
  add_choice(*runs, measured->choice);
  add_explain_flag(*runs, measured->choice);
  add_results(*runs, measured->results,
              "new results file, or with --resume an existing one (default: a new one here)");
  add_resume(*runs, measured->resume);
  add_report_format(*runs, measured->format, measured->full);
  auto flags = std::make_shared<GateFlags>(*runs, gate::Use::fail_if);
  runs->calls([measured, flags] { return run(*measured, *flags); });

  auto* shells = command->add_subcommand("shell", "Opens a shell in the simulated machine");
  auto looked = std::make_shared<LabFlags>();
  looked->add(*shells);
  shells->calls([looked] { return shell(*looked); });
}

}  // namespace ontime::app

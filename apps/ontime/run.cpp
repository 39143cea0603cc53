// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <map>
#include <memory>

#include <fmt/format.h>

#include "campaign/campaign.hpp"
#include "commands.hpp"
#include "flags.hpp"
#include "gates.hpp"
#include "in_lab.hpp"
#include "listen_beside.hpp"
#include "machine/machine.hpp"
#include "measured.hpp"
#include "output.hpp"
#include "scenario_files.hpp"
#include "statistics/statistics.hpp"
#include "terminal.hpp"

namespace ontime::app {
namespace {

struct RunArguments {
  std::vector<std::string> scenarios;
  Choice choice;
  std::string results, send_to, format = "table";
  bool resume = false, only_measure = false, full = false;
};

// In the lab's machine that counts instructions as time, a second takes many real ones.
bool has_simulated_time() {
  const auto by = machine::describe().at("simulated");
  return by.is_string() && by.get<std::string>().find(machine::live_time) == std::string::npos;
}

void expect(Terminal& terminal, const std::vector<campaign::Scenario>& scenarios,
            const campaign::Done& done) {
  campaign::Plan all;
  bool searches = false;
  for (const auto& scenario : scenarios) {
    for (const auto& [key, notice] : scenario.notices) terminal.note(notice);
    const auto plan = campaign::plan_of(scenario, done);
    all.runs += plan.runs, all.known += plan.known, all.time += plan.time;
    searches =
        searches || std::ranges::any_of(scenario.runs, [](const auto& run) { return run.step.of > 0; });
  }
  const std::string kind = has_simulated_time() ? simulated_time : "";
  terminal.expect(all, kind);
  if (all.runs < 2) return;
  const auto known = all.known > 0 ? fmt::format(", {} already in results", all.known) : "";
  const auto time = all.known < all.runs ? fmt::format(", about {}{}", about(all.time), kind) : "";
  terminal.note(fmt::format("{}{} runs{}{}", searches ? "at most " : "", all.runs, known, time));
}

bool is_same(const nlohmann::json& one, const nlohmann::json& other) {
  const auto names = {"repetition", "scenario", "ontime"};
  return std::ranges::all_of(
      names, [&](const char* name) { return record::at(one, name) == record::at(other, name); });
}

// For --resume: finds the complete run with the same conditions, repetition, scenario text and version of
// ontime. Throws Error{2} if that run was measured on another machine or kernel.
campaign::Done done_in(const record::Reader& reader) {
  std::multimap<std::string, record::Run> complete;  // by key
  for (auto& run : reader.runs()) {
    if (!statistics::is_complete(run)) continue;
    // The search ends where its report does, also by what an older ontime did not count.
    if (run.asked.step.of > 0) run = statistics::summarise(reader, run).run;
    const auto key = run.key;
    complete.emplace(key, std::move(run));
  }
  return [complete = std::move(complete)](const auto& asked, const auto& machines) -> const record::Outcome* {
    const auto [first, last] = complete.equal_range(record::key_of(asked));
    for (auto known = first; known != last; ++known) {
      const auto& run = known->second;
      if (!is_same(run.asked.document, asked)) continue;
      check_machines(run, machines);
      return &run.outcome;
    }
    return nullptr;
  };
}

// Besides showing progress: listens to the robot's own messages (listen.topics), and sends each recorded run
// out of the lab's machine.
class Beside final : public Terminal {
 public:
  Beside(record::Writer& writer, std::string send_to) : writer_(writer), send_to_(std::move(send_to)) {}
  void begins_listening(const campaign::Run& run) override {
    listening_ = std::make_unique<ListenBeside>(writer_, run, command_line());
  }
  bool listens() override { return listening_->is_there(); }
  void progress(const roundtrip::Counters& counters, std::chrono::nanoseconds elapsed) override {
    Terminal::progress(counters, elapsed);
    if (listening_) listening_->write();
  }
  void ends_listening(bool interrupted) override {
    remarks_ = listening_->end(interrupted);
    listening_.reset();
  }
  void recorded(std::int64_t run) override {
    Terminal::recorded(run);
    if (listening_) ends_listening(true);  // the run ended early
    for (const auto& text : remarks_) {
      note("listen.topics: " + text);
      writer_.note(run, {"listening", "listen.topics: " + text, {}, {}});
    }
    remarks_.clear();
    if (!send_to_.empty()) send_from_lab(writer_, run, send_to_);
  }

 private:
  record::Writer& writer_;
  const std::string send_to_;
  std::unique_ptr<ListenBeside> listening_;
  std::vector<std::string> remarks_;
};

int run(const RunArguments& arguments, const GateFlags& flags) {
  const auto selection = arguments.choice.checked();
  const auto format = format_flag(arguments.format);
  const auto gates = flags.gates();
  // All are read before the first is run.
  const auto scenarios = campaign::read_scenarios(scenario_files(arguments.scenarios), selection);
  const auto results =
      arguments.results.empty() ? new_results_file(arguments.scenarios.front()) : arguments.results;
  auto& interrupts = catch_interrupts("interrupted: restoring settings …");
  flags.begin_junit();
  record::Writer writer(results);
  const auto before = writer.reader().runs().size();
  const auto done = arguments.resume ? done_in(writer.reader()) : campaign::Done();
  Beside terminal(writer, arguments.send_to);
  expect(terminal, scenarios, done);
  int code = 0;
  std::string unfinished;
  for (const auto& scenario : scenarios) {
    if (code == 130) break;
    // After either error, what was measured until then is kept.
    try {
      code = std::max(code, campaign::execute(scenario, writer, terminal, interrupts, command_line(), done));
    } catch (const campaign::Error& error) {  // such as a lost host, which the next scenario may not need
      terminal.note(unfinished = error.what());
      code = std::max(code, interrupts > 0 ? 130 : error.exit);
    } catch (const record::Error& error) {  // such as a full disk: nothing more can be recorded
      terminal.note(unfinished = error.what());
      code = std::max(code, 3);
      break;
    }
  }
  if (arguments.only_measure) return code;
  const auto go_on = code == 130 ? to_go_on(results, !arguments.results.empty(), arguments.resume) : "";
  // With --resume the report is of all runs, unless it was refused.
  const bool none = code != 0 && writer.reader().runs().size() == before;
  const auto known = arguments.resume && !none ? 0 : before;
  return show_measured({writer, results, known, code, unfinished, go_on}, format, arguments.full, flags,
                       gates, terminal);
}

}  // namespace

void add_run(Command& app) {
  auto* command = app.add_subcommand(
      "run",
      "Runs scenarios: applies settings and load, measures round trips, writes results and an HTML page");
  command->footer(fmt::format(
      "A scenario is code: it can name programs that run here, and files. Read a scenario from others "
      "before you run it.\n\n{}",
      exit_codes));
  auto arguments = std::make_shared<RunArguments>();
  command
      ->add_option("SCENARIO", arguments->scenarios,
                   "scenario files, folders, or names that `ontime scenarios` lists")
      ->required();
  add_choice(*command, arguments->choice);
  add_explain_flag(*command, arguments->choice);
  command->add_flag("--deploy", arguments->choice.selection.deploy,
                    "copy this program to the ssh hosts for the run, then remove it");
  add_cable(*command, arguments->choice);
  add_results(*command, arguments->results, "add to this results file (default: a new one here)");
  add_resume(*command, arguments->resume);
  add_report_format(*command, arguments->format, arguments->full);
  // For the lab's machine, which only measures; the caller shows, judges and keeps.
  command->add_flag("--only-measure", arguments->only_measure, "measure, and show nothing")->group("");
  command->add_option("--send-to", arguments->send_to, "each run, once it is recorded")->group("");
  auto flags = std::make_shared<GateFlags>(*command, gate::Use::fail_if);
  command->calls([arguments, flags] { return run(*arguments, *flags); });
}

}  // namespace ontime::app

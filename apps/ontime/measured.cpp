// SPDX-License-Identifier: Apache-2.0
#include "measured.hpp"

#include <algorithm>
#include <ctime>
#include <filesystem>
#include <span>
#include <system_error>
#include <utility>

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include "flags.hpp"
#include "output.hpp"
#include "page/page.hpp"
#include "report/explained.hpp"
#include "scenario_files.hpp"
#include "spelling/spelling.hpp"
#include "table/table.hpp"
#include "transport/shipped.hpp"

namespace ontime::app {
namespace {

namespace fs = std::filesystem;

// Checked before the first run, so that a typo does not fail after hours. (A scenario's transport that this
// machine lacks fails only its own runs.)
void check_transports(const std::vector<std::string>& names) {
  const auto here = transport::available();
  for (const auto& name : names) {
    if (std::ranges::count(names, name) > 1) throw wrong("--transports: '{}' occurs twice", name);
    if (std::ranges::find(here, name) == here.end())
      throw campaign::Error(transport::shipped(name) != nullptr ? 3 : 2,
                            fmt::format("--transports: transport '{}' is not installed{}; installed: {}",
                                        name, spelling::suggestion(name, here), fmt::join(here, ", ")));
  }
}

using Notes = std::vector<std::pair<std::int64_t, record::Note>>;  // with the run's number

// Adds a note once, even if the runs are resumed again.
void note(statistics::Summary& summary, const gate::Judgement& judgement, Notes& notes) {
  const bool missed = judgement.result == gate::Judgement::Result::missed;
  const auto text = fmt::format("{}: {}: {}", gate::word_of(judgement), judgement.gate, judgement.says);
  const bool known =
      std::ranges::any_of(summary.notes, [&](const auto& before) { return before.text == text; });
  if (known) return;
  summary.notes.push_back({missed ? gate::missed_note : gate::open_note, text, {}, {}});
  notes.emplace_back(summary.run.number, summary.notes.back());
}

// Judges the new runs, from `known` on, by their scenario and the flags. Adds to `notes` what does not hold.
std::vector<gate::Judgement> judge(std::vector<statistics::Summary>& summaries, std::size_t known,
                                   const GateFlags& flags, const std::vector<gate::Gate>& gates,
                                   Notes& notes) {
  std::vector<gate::Judgement> judgements;
  for (auto& summary : std::span(summaries).subspan(known)) {
    if (gate::is_superseded(summary, summaries)) continue;
    for (auto& judgement : flags.judge(gates, summary)) {
      if (judgement.result != gate::Judgement::Result::held && judgement.gate != gate::as_asked)
        note(summary, judgement, notes);
      judgements.push_back(std::move(judgement));
    }
  }
  return judgements;
}

// On a full disk the notes are lost, but the table is still shown.
void keep(record::Writer& writer, const Notes& notes) {
  try {
    for (const auto& [run, note] : notes) writer.note(run, note);
    writer.flush();
  } catch (const record::Error& error) {
    print_error(fmt::format("missed requirements are not recorded in the results: {}", error.what()));
  }
}

}  // namespace

campaign::Selection Choice::checked() const {
  auto checked = selection;
  if (!duration.empty()) checked.duration = duration_flag("--duration", duration);
  check_transports(checked.transports);
  return checked;
}

void add_choice(Command& command, Choice& choice) {
  add_list(command, "--only", choice.selection.only, "ID,...", "only the runs with these ids");
  add_list(command, "--transports", choice.selection.transports, "TRANSPORT,...",
           "use these transports instead of the scenario's");
  add_value(command, "--duration", choice.duration, "TIME",
            "duration of each run, instead of the scenario's");
}

void add_explain_flag(Command& command, Choice& choice) {
  command.add_flag("--explain", choice.selection.explain,
                   "record kernel events around late, lost and the worst messages, for `ontime explain`");
}

void add_cable(Command& command, Choice& choice) {
  add_list(command, "--cable", choice.selection.cable, "NAME,NAME",
           "with hosts: namespaces: use these two interfaces instead of a virtual link; they must be down, "
           "and joined by a cable");
}

std::string new_results_file(const std::string& scenario) {
  auto path = fs::absolute(scenario).lexically_normal();
  if (!path.has_filename()) path = path.parent_path();  // "paper/", "."
  const auto stem =
      fmt::format("{}-{:%Y%m%d-%H%M%S}", path.stem().string(), fmt::localtime(std::time(nullptr)));
  auto name = stem + ".ontime";
  for (int next = 2; exists(fs::symlink_status(name)); ++next) name = fmt::format("{}-{}.ontime", stem, next);
  return name;
}

void check_results(const std::string& file, bool resume) {
  std::error_code unknown;  // then opening it says why
  if (!resume && fs::exists(fs::symlink_status(file, unknown)))
    throw wrong("--results: {} exists. Fix: name another file, or continue this one with --resume", file);
}

std::string write_page_beside(const std::string& results, const record::Reader& reader,
                              const std::vector<statistics::Summary>& summaries) {
  const bool is_usual = fs::path(results).extension() == ".ontime";  // "day.1" and "day.2" have a page each
  auto path = is_usual ? fs::path(results).replace_extension("html").string() : results + ".html";
  std::error_code none;
  if (fs::exists(path, none) && !(fs::is_regular_file(path, none) && can_replace(path, Kind::page)))
    throw wrong("{} exists and is not an ontime page. Fix: ontime report {} --format html --output FILE",
                path, results);
  // The file may have runs that another process measured.
  const report::Origin origin{.file = fs::path(results).filename().string(), .trusts = is_trusted};
  write_whole(path, page::page_of(reader, summaries, origin), Kind::page);
  return path;
}

std::string to_go_on(const std::string& results, bool named, bool resumes) {
  auto words = command_line().get<std::vector<std::string>>();
  if (!named) words.insert(words.end(), {"--results", results});
  if (!resumes) words.emplace_back("--resume");
  return table::line_to_paste(words).value_or("");
}

bool is_for_people(report::Format format) {
  return format == report::Format::table || format == report::Format::markdown;
}

void explain_new(record::Writer& writer, std::size_t known, report::Format format) {
  const auto reader = writer.reader();
  const auto runs = reader.runs();
  std::vector<report::Explained> all;
  for (std::size_t i = known; i < runs.size(); ++i)
    if (auto account = explain::account_of(reader, runs[i]); account.traced)
      all.push_back({runs[i], std::move(account)});
  if (!all.empty()) print("\n" + report::render_explained(all, format));
}

void check_machines(const record::Run& run, const record::ByName<record::Machine>& now) {
  for (const auto& [host, machine] : now) {
    const auto before = record::find(run.outcome.hosts, host).machine;
    std::vector<std::string> differences;
    for (const auto* name : {"hostname", "kernel_release", "kernel_version", "cpu_model"})
      if (const auto& then = record::at(before.document, name), &is = record::at(machine.document, name);
          then != is)
        differences.push_back(fmt::format("{} {}, not {}", name, then.dump(), is.dump()));
    if (!differences.empty())
      throw wrong(
          "--resume: run {} was measured on another machine or kernel than the {}'s: {}. Fix: start a new "
          "results file",
          run.number, host, fmt::join(differences, "; "));
  }
}

int show_measured(const Measured& measured, report::Format format, bool full, const GateFlags& flags,
                  const std::vector<gate::Gate>& gates, Terminal& terminal) {
  terminal.does("judging the runs");
  auto summaries = statistics::summarise(measured.writer.reader());
  const auto say_how_to_go_on = [&] {
    if (!measured.to_go_on.empty()) terminal.note("to continue: " + measured.to_go_on);
  };
  if (summaries.size() == measured.known) {  // no run was measured
    say_how_to_go_on();
    return measured.code;
  }
  Notes notes;
  auto judgements = judge(summaries, measured.known, flags, gates, notes);
  if (flags.wanted() && !measured.unfinished.empty())
    judgements.push_back(
        {gate::Judgement::Result::cannot_judge, measured.results, gate::as_asked, measured.unfinished});
  keep(measured.writer, notes);
  const std::vector<statistics::Summary> fresh(
      summaries.begin() + static_cast<std::ptrdiff_t>(measured.known), summaries.end());
  terminal.does("drawing the page");
  try {
    terminal.note(fmt::format("results: {}; page: {}", measured.results,
                              write_page_beside(measured.results, measured.writer.reader(), summaries)));
  } catch (const std::exception& error) {  // the samples are already in the results file
    terminal.note(fmt::format("results: {}; no page: {}", measured.results, error.what()));
  }
  const int judged = flags.finish(std::move(judgements), measured.results);
  // Last, so that the terminal shows it.
  print(shown(fresh, format, full, {.file = measured.results, .is_own = true, .finish = measured.to_go_on}));
  if (full && is_for_people(format)) explain_new(measured.writer, measured.known, format);
  if (full || format != report::Format::table) say_how_to_go_on();  // the summary says it
  return measured.code == 130 ? measured.code : std::max(measured.code, judged);
}

}  // namespace ontime::app

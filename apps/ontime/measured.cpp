// SPDX-License-Identifier: Apache-2.0
#include "measured.hpp"

#include <algorithm>
#include <cerrno>
#include <ctime>
#include <filesystem>
#include <span>
#include <system_error>
#include <utility>

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>

#include "flags.hpp"
#include "output.hpp"
#include "page/page.hpp"
#include "report/explained.hpp"
#include "spelling/spelling.hpp"
#include "table/table.hpp"

namespace ontime::app {
namespace {

namespace fs = std::filesystem;

constexpr const char* mark_of_page = "<meta name=\"generator\" content=\"ontime";

// A slip of the pen in what was asked for by name must not show only after hours. (A transport that a
// scenario lists and this machine lacks costs its own runs only.)
void check_transports(const std::vector<std::string>& names) {
  const auto here = transport::available();
  for (const auto& name : names)
    if (std::ranges::find(here, name) == here.end())
      throw campaign::Error(3, fmt::format("--transports: there is no transport '{}' here{}; there are: {}",
                                           name, spelling::suggestion(name, here), fmt::join(here, ", ")));
}

using Notes = std::vector<std::pair<std::int64_t, record::Note>>;  // by the number of their run

// Once, however often the runs are resumed.
void note(statistics::Summary& summary, const gate::Judgement& judgement, Notes& notes) {
  const bool missed = judgement.result == gate::Judgement::Result::missed;
  const auto text = fmt::format("{}: {}: {}", gate::word_of(judgement), judgement.gate, judgement.says);
  const bool known =
      std::ranges::any_of(summary.notes, [&](const auto& before) { return before.text == text; });
  if (known) return;
  summary.notes.push_back({missed ? "gate-missed" : "gate-not-judged", text, {}, {}});
  notes.emplace_back(summary.run.number, summary.notes.back());
}

// From the first that is not known on, by what their scenario and the flags say; `notes`: what does not hold.
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

// A disk that is full takes them no more: that costs them, and not the table.
void keep(record::Writer& writer, const Notes& notes, Terminal& terminal) {
  try {
    for (const auto& [run, note] : notes) writer.note(run, note);
    writer.flush();
  } catch (const record::Error& error) {
    terminal.note(fmt::format("what did not hold is not in the results: {}", error.what()));
  }
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

}  // namespace

campaign::Selection Choice::checked() const {
  auto checked = selection;
  if (!duration.empty()) checked.duration = duration_flag("--duration", duration);
  check_transports(checked.transports);
  return checked;
}

void add_choice(Command& command, Choice& choice) {
  add_list(command, "--only", choice.selection.only, "ID,...", "only these runs");
  add_list(command, "--transports", choice.selection.transports, "TRANSPORT,...",
           "these, instead of those of the scenario");
  add_value(command, "--duration", choice.duration, "TIME", "of each run, instead of the scenario's");
  command.add_flag(
      "--explain", choice.selection.explain,
      "keep what the kernels did around late, lost and the worst messages, for `ontime explain`");
}

void add_cable(Command& command, Choice& choice) {
  add_list(command, "--cable", choice.selection.cable, "NAME,NAME",
           "with hosts: namespaces: two unused interfaces of this machine, which are down and joined "
           "by a cable, instead of a virtual one");
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
  if (!resume && fs::exists(fs::symlink_status(file)))
    throw campaign::Error(2,
                          fmt::format("--results: {} exists. Name another file, or measure what is missing "
                                      "in it with --resume",
                                      file));
  if (const auto folder = fs::absolute(file).parent_path(); access(folder.c_str(), W_OK | X_OK) != 0)
    throw campaign::Error(3, fmt::format("--results: {} cannot be written there: {}: name another file", file,
                                         std::generic_category().message(errno)));
}

std::string write_page_beside(const std::string& results, const record::Reader& reader,
                              const std::vector<statistics::Summary>& summaries) {
  const bool is_usual = fs::path(results).extension() == ".ontime";  // "day.1" and "day.2" have a page each
  auto path = is_usual ? fs::path(results).replace_extension("html").string() : results + ".html";
  std::error_code none;
  if (fs::exists(path, none) &&
      !(fs::is_regular_file(path, none) && beginning_of(path, 1024).find(mark_of_page) != std::string::npos))
    throw campaign::Error(
        2, fmt::format("{} is there and no page of ontime's. Name another: ontime report {} --format "
                       "html --output FILE",
                       path, results));
  Output output(path);
  output.write(page::page_of(reader, summaries, fs::path(results).filename().string()));
  output.finish();
  return path;
}

std::string to_go_on(const std::string& results, bool named, bool resumes) {
  auto words = command_line().get<std::vector<std::string>>();
  if (!named) words.insert(words.end(), {"--results", results});
  if (!resumes) words.emplace_back("--resume");
  return "to go on: " + table::shell_line(words);
}

int show_measured(const Measured& measured, report::Format format, bool full, const GateFlags& flags,
                  const std::vector<gate::Gate>& gates, Terminal& terminal) {
  terminal.clear_line();
  auto summaries = statistics::summarise(measured.writer.reader());
  if (summaries.size() == measured.known) return measured.code;  // ended before the first
  Notes notes;
  auto judgements = judge(summaries, measured.known, flags, gates, notes);
  if (flags.wanted() && !measured.unfinished.empty())
    judgements.push_back(
        {gate::Judgement::Result::cannot_judge, measured.results, gate::as_asked, measured.unfinished});
  keep(measured.writer, notes, terminal);
  const std::vector<statistics::Summary> fresh(
      summaries.begin() + static_cast<std::ptrdiff_t>(measured.known), summaries.end());
  try {
    terminal.note(fmt::format("results: {}; page: {}", measured.results,
                              write_page_beside(measured.results, measured.writer.reader(), summaries)));
  } catch (const std::exception& error) {  // the samples are safe all the same
    terminal.note(fmt::format("results: {}; no page: {}", measured.results, error.what()));
  }
  const int judged = flags.finish(std::move(judgements), measured.results);
  print(shown(fresh, format, full, measured.results));  // last, for a terminal shows the end
  if (full) explain_new(measured.writer, measured.known, format);
  return measured.code == 130 ? measured.code : std::max(measured.code, judged);
}

}  // namespace ontime::app

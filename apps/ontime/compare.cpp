// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <filesystem>
#include <iterator>
#include <set>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "chosen_runs.hpp"
#include "commands.hpp"
#include "conditions/conditions.hpp"
#include "flags.hpp"
#include "gates.hpp"
#include "output.hpp"
#include "plot.hpp"
#include "report/comparison.hpp"
#include "spelling/spelling.hpp"

namespace ontime::app {
namespace {

using Summaries = std::vector<statistics::Summary>;

struct CompareArguments {
  std::string a, b, from, to, by, format, output, plot;
  std::vector<std::string> only;
  bool single_runs = false, full = false;
};

Summaries only(const std::string& file, const std::vector<std::string>& words) {
  return chosen_summaries(record::Reader(file), file, words);
}

// An id or a number; a number stands for the run and its repetitions.
Summaries alike(const std::string& file, const std::string& word) {
  const record::Reader reader(file);
  std::set<std::string> keys;
  std::set<std::int64_t> numbers;
  for (const auto& run : chosen_runs(reader, file, {word})) {
    keys.insert(run.key);
    numbers.insert(run.number);
  }
  auto runs = reader.runs();
  std::erase_if(runs, [&](const auto& run) {
    return !numbers.contains(run.number) && !(keys.size() == 1 && !run.key.empty() && keys.contains(run.key));
  });
  return summaries_of(reader, runs);
}

// Runs with one id can have different conditions.
void refuse_unlike(const std::string& flag, const std::string& word, const report::Comparison::Runs& runs) {
  if (const auto* const other = report::unlike(runs))
    throw wrong("{} {}: runs {} and {} have different conditions. Fix: state the number of one of them", flag,
                word, runs.front()->run.number, other->run.number);
}

void refuse_the_same(const CompareArguments& arguments) {
  throw wrong("A and B have runs of {} in common. Fix: name another file, or use --from and --to, or --by",
              arguments.a);
}

bool is_same_file(const CompareArguments& arguments) {
  std::error_code ignored;
  return arguments.b.empty() || std::filesystem::equivalent(arguments.a, arguments.b, ignored);
}

// No run has a value of this key: it may be misspelt. Transports name their options themselves, and
// "executor" may mean options.executor.
void refuse_unknown(const std::string& key, const Summaries& runs) {
  if (key.starts_with("options.")) return;
  std::vector<std::string> paths;
  std::set<std::string> groups, differ;
  for (const auto& known : conditions::fields()) {
    if (known.path == conditions::current_key(key) || known.json == key) return;
    if (known.path.empty()) continue;
    paths.push_back(known.path);
    groups.insert(known.path.substr(0, known.path.find('.')));
  }
  if (groups.contains(key)) throw wrong("--by: no run has {}. See: ontime report", key);
  for (const auto& group : groups)  // each once: a file may have very many values
    if (report::values_of(runs, group).size() > 1) differ.insert(group);
  std::string meant;
  for (const auto& run : runs)
    for (const auto& [name, value] : run.run.asked.task.config.options) {
      paths.push_back("options." + name);
      if (name == key) meant = fmt::format(" (did you mean '{}'?)", paths.back());
    }
  if (meant.empty()) meant = spelling::suggestion(key, paths);
  if (meant.empty() && !differ.empty())
    meant = fmt::format("; these differ between the runs: {}", fmt::join(differ, ", "));
  throw wrong("--by: unknown key '{}'{}", key, meant);
}

// The comparison points into `a` and `b`.
report::Comparison compare_by(const CompareArguments& arguments, Summaries& a, Summaries& b) {
  if (!arguments.b.empty()) throw wrong("--by compares runs of one file. Fix: omit B");
  a = only(arguments.a, arguments.only);
  auto values = report::values_of(a, arguments.by);
  if (values == std::vector<std::string>{report::unset}) refuse_unknown(arguments.by, a);
  const bool is_group = conditions::key_named(conditions::current_key(arguments.by)) == nullptr;
  if (values.size() > 2 && arguments.from.empty() && !is_group) std::erase(values, report::unset);
  auto words = report::words_of_values(arguments.by, values);
  const auto listed = fmt::format("{}: {}", arguments.by, fmt::join(words, ", "));
  if (!arguments.from.empty()) {
    const auto chosen = [&](const std::string& value) {
      auto found = std::ranges::find(words, value);
      if (found == words.end()) found = std::ranges::find(words, report::words_of_value(arguments.by, value));
      if (found == words.end()) throw wrong("--by: no run has '{}'. Found {}", value, listed);
      return static_cast<std::size_t>(found - words.begin());
    };
    const auto from = chosen(arguments.from), to = chosen(arguments.to);
    values = {values[from], values[to]};
    words = {words[from], words[to]};
  }
  if (values.size() != 2)
    throw wrong("--by needs two values to compare; found {} ({}). {}", values.size(), listed,
                values.size() > 2 ? "Fix: choose two with --from and --to" : "See: ontime report");
  if (values[0] == values[1]) refuse_the_same(arguments);
  auto comparison = report::compare_by(a, arguments.by, values[0], values[1]);
  comparison.from_name = arguments.by + ' ' + words[0];
  comparison.to_name = arguments.by + ' ' + words[1];
  for (const auto& pair : comparison.pairs)
    for (const auto* run : pair.to) b.push_back(*run);
  return comparison;
}

report::Comparison compare_chosen(const CompareArguments& arguments, Summaries& a, Summaries& b) {
  a = alike(arguments.a, arguments.from);
  b = alike(arguments.b.empty() ? arguments.a : arguments.b, arguments.to);
  auto comparison = report::compare_chosen(a, b);
  if (const auto why = report::why_never(comparison); !why.empty())
    throw wrong("--from {} --to {}: {}. Fix: choose runs that measure the same", arguments.from, arguments.to,
                why);
  const bool same_file = is_same_file(arguments);
  for (const auto& pair : comparison.pairs) {
    refuse_unlike("--from", arguments.from, pair.from);
    refuse_unlike("--to", arguments.to, pair.to);
    if (same_file && report::has_run_on_both_sides(pair))
      throw wrong(
          "--from {} --to {}: both name the same runs: an id means all its runs, a number its repetitions "
          "too. Fix: choose runs with different conditions",
          arguments.from, arguments.to);
  }
  return comparison;
}

report::Comparison compare_files(const CompareArguments& arguments, Summaries& a, Summaries& b) {
  if (arguments.b.empty()) throw wrong("compare needs a second results file, or --from and --to, or --by");
  if (is_same_file(arguments)) refuse_the_same(arguments);
  a = only(arguments.a, arguments.only);
  b = only(arguments.b, arguments.only);
  auto comparison = report::compare(a, b);
  if (const auto why = report::why_never(comparison); !why.empty())
    throw wrong("{} and {}: {}", arguments.a, arguments.b, why);
  return comparison;
}

std::string run_or_id(const std::string& word) {
  return word.find_first_not_of("0123456789") == word.npos ? "run " + word : word;
}

// Names both sides. Returns the command that prints every table.
std::string name_sides(const CompareArguments& arguments, report::Comparison& comparison) {
  std::vector<std::string> words = {"ontime", "compare"};
  for (const auto& name : {arguments.a, arguments.b})
    if (!name.empty()) words.push_back(table::as_operand(name));
  for (const auto& [flag, value] :
       {std::pair{"--by", arguments.by}, {"--from", arguments.from}, {"--to", arguments.to}})
    if (!value.empty()) words.insert(words.end(), {flag, value});
  if (!arguments.only.empty()) words.insert(words.end(), {"--only", table::join(arguments.only, ",")});
  words.emplace_back("--full");
  comparison.one_file = arguments.b.empty();
  const auto file = [](const std::string& path) { return std::filesystem::path(path).filename().string(); };
  if (arguments.by.empty() && !arguments.from.empty() && arguments.from != arguments.to) {
    comparison.from_name = run_or_id(arguments.from);
    comparison.to_name = run_or_id(arguments.to);
  } else if (!arguments.b.empty() && file(arguments.a) != file(arguments.b)) {
    comparison.from_name = file(arguments.a);
    comparison.to_name = file(arguments.b);
  }
  return table::shell_line(words);
}

void draw(const report::Comparison& comparison, const std::string& file) {
  plot::Plot plot;
  plot.form = form_of("--plot", file);
  if (comparison.pairs.empty())
    throw wrong(
        "--plot: no run of A has the same conditions as a run of B. To see what differs, omit --plot");
  const auto commands = plot::gnuplot_of(comparison, plot);
  if (commands.empty())
    throw wrong("--plot: no metric has a change to draw. Check that the runs are complete: ontime report");
  write_whole(file, drawn(commands), Kind::figure);
}

int compare(const CompareArguments& arguments, const GateFlags& flags) {
  const auto format = format_flag(arguments.format, arguments.output);
  const auto gates = flags.gates();
  if (arguments.from.empty() != arguments.to.empty()) throw wrong("--from and --to must be used together");
  Summaries a, b;
  auto comparison = !arguments.by.empty()     ? compare_by(arguments, a, b)
                    : !arguments.from.empty() ? compare_chosen(arguments, a, b)
                                              : compare_files(arguments, a, b);
  const auto full_command = name_sides(arguments, comparison);
  const auto single_runs = arguments.single_runs ? gate::SingleRuns::judged : gate::SingleRuns::open;

  std::vector<gate::Judgement> judgements;
  for (const auto& pair : comparison.pairs)
    for (const auto& gate : gates)
      if (gate.is_relative()) judgements.push_back(gate::judge(gate, pair.from, pair.to, single_runs));
  std::ranges::move(flags.judge_wanted(gates, b), std::back_inserter(judgements));
  // A run without a partner in B does not pass.
  if (flags.wanted())
    for (const auto& runs : comparison.only_from)
      judgements.push_back({gate::Judgement::Result::cannot_judge, gate::name_of(runs),
                            "B has a run to compare with", "no run of B has the same conditions"});
  if (flags.wanted() && comparison.pairs.empty() && comparison.only_from.empty())
    judgements.push_back({gate::Judgement::Result::cannot_judge, arguments.a, "A and B have runs to compare",
                          "A has no run to compare with"});

  if (!arguments.plot.empty()) draw(comparison, arguments.plot);
  Output output(arguments.output, kind_of(format));
  const auto text =
      arguments.full ? report::render(comparison, judgements, format, output_columns())
                     : report::render_answer(comparison, judgements, format, full_command, output_columns());
  const bool shown = arguments.output.empty() && format != report::Format::csv;
  // Before the text: a reader that closes the pipe (`| head`) ends this process.
  const int code =
      flags.finish(std::move(judgements), arguments.b.empty() ? arguments.a : arguments.b, shown);
  output.write(text);
  output.finish();
  return code;
}

}  // namespace

void add_compare(Command& app) {
  auto* command = app.add_subcommand(
      "compare", "Shows what changed between two results files, with confidence intervals");
  auto arguments = std::make_shared<CompareArguments>();
  command->add_option("A", arguments->a, "results file before the change")->required();
  command->add_option("B", arguments->b, "results file after the change");
  add_only(*command, arguments->only);
  command
      ->add_option("--from", arguments->from,
                   "compare the run with this id or number, and its repetitions, …", "RUN")
      ->excludes("--only");
  command->add_option("--to", arguments->to, "… with this run of A or B; their conditions may differ", "RUN")
      ->excludes("--only");
  command->add_option(
      "--by", arguments->by,
      "compare runs of A that differ only in this key, such as kernel.threaded-napi; --from and "
      "--to choose two values",
      "KEY");
  command->add_flag(
      "--single-runs", arguments->single_runs,
      "with --fail-if: judge a change even if a side has one run; differences between runs are then ignored");
  add_report_format(*command, arguments->format, arguments->full);
  add_report_output(*command, arguments->output);
  add_file(*command, "--plot", arguments->plot, "also draw a figure: .svg, .pdf or .png");
  auto flags = std::make_shared<GateFlags>(*command, gate::Use::fail_if_compared);
  command->calls([arguments, flags] { return compare(*arguments, *flags); });
}

}  // namespace ontime::app

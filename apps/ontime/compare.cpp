// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include <fmt/format.h>

#include "campaign/campaign.hpp"
#include "commands.hpp"
#include "flags.hpp"
#include "gates.hpp"
#include "output.hpp"
#include "plot.hpp"

namespace ontime::app {
namespace {

using campaign::Error;
using Summaries = std::vector<statistics::Summary>;

struct Arguments {
  std::string a, b, from, to, format = "table", output, plot;
  std::vector<std::string> only;
};

bool is_called(const record::Run& run, const std::string& word) {
  return std::to_string(run.number) == word ||
         (run.asked.is_object() && run.asked.value("id", nlohmann::json()) == word);
}

// The runs of a file that have one of these ids or numbers; all, if there are none.
Summaries summaries_of(const std::string& file, const std::string& flag,
                       const std::vector<std::string>& words) {
  const record::Reader reader(file);
  const auto runs = reader.runs();
  for (const auto& word : words)
    if (std::none_of(runs.begin(), runs.end(), [&](const auto& run) { return is_called(run, word); }))
      throw Error(2, fmt::format("{}: {} has no run with the id or the number '{}'", flag, file, word));
  Summaries summaries;
  for (const auto& run : runs)
    if (words.empty() ||
        std::any_of(words.begin(), words.end(), [&](const auto& word) { return is_called(run, word); }))
      summaries.push_back(statistics::summarise(reader, run));
  return summaries;
}

// Runs of one id need not be repetitions of one another.
void refuse_unlike(const std::string& flag, const std::string& word, const report::Comparison::Runs& runs) {
  for (const auto* run : runs)
    if (run->run.key != runs.front()->run.key)
      throw Error(
          2, fmt::format("{} {}: runs {} and {} were not measured under the same conditions: say the number "
                         "of one",
                         flag, word, runs.front()->run.number, run->run.number));
}

void draw(const report::Comparison& comparison, const std::string& file) {
  report::Plot plot;
  plot.form = form_of("--plot", file);
  const auto commands = report::gnuplot_of(comparison, plot);
  if (commands.empty())
    throw Error(2, "--plot: no metric has a change to draw. Were the runs measured to their end?");
  Output output(file);
  output.write(drawn(commands));
  output.finish();
}

int compare(const Arguments& arguments, const GateFlags& flags) {
  const auto format = format_flag(arguments.format);
  const auto gates = flags.gates();
  const bool chosen = !arguments.from.empty();
  if (chosen == arguments.to.empty())
    throw Error(2, "--from and --to belong together: the runs to compare, and those to compare them with");
  if (!chosen && arguments.b.empty())
    throw Error(2,
                "a second results file is needed, or --from and --to, which say what to compare in the one");

  const auto& second = arguments.b.empty() ? arguments.a : arguments.b;
  const auto words = [&](const std::string& word) { return chosen ? std::vector{word} : arguments.only; };
  const auto a = summaries_of(arguments.a, chosen ? "--from" : "--only", words(arguments.from));
  const auto b = summaries_of(second, chosen ? "--to" : "--only", words(arguments.to));
  const auto comparison = chosen ? report::compare_chosen(a, b) : report::compare(a, b);
  for (const auto& pair : comparison.pairs) {
    refuse_unlike("--from", arguments.from, pair.from);
    refuse_unlike("--to", arguments.to, pair.to);
  }

  std::vector<gate::Judgement> judgements;
  for (const auto& pair : comparison.pairs)
    for (const auto& gate : gates)
      if (gate.is_relative()) judgements.push_back(gate::judge(gate, pair.from, pair.to));
  if (flags.wanted())
    for (const auto& run : b)
      if (!gate::is_superseded(run, b))
        for (auto& judgement : flags.judge(gates, run)) judgements.push_back(std::move(judgement));
  // What cannot be compared any more holds no line.
  if (flags.wanted())
    for (const auto& runs : comparison.only_from)
      judgements.push_back({gate::Judgement::Result::cannot_judge, gate::name_of(runs),
                            "there is a run of B to compare with", "there is none with the same conditions"});
  if (flags.wanted() && comparison.pairs.empty() && comparison.only_from.empty())
    judgements.push_back({gate::Judgement::Result::cannot_judge, arguments.a, "there is something to compare",
                          "A has no run to compare with"});

  if (!arguments.plot.empty()) draw(comparison, arguments.plot);
  Output output(arguments.output);
  output.write(report::render(comparison, judgements, format));
  output.finish();
  return flags.finish(std::move(judgements), second);
}

}  // namespace

void add_compare(Command& app, Action& action) {
  auto* command =
      app.add_subcommand("compare", "What changed from one results file to another, and how surely");
  auto arguments = std::make_shared<Arguments>();
  command->add_option("A", arguments->a, "a results file: what it was")->required();
  command->add_option("B", arguments->b, "another: what it is now");
  command->add_option("--only", arguments->only, "only runs with these ids or numbers")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->type_name("ID,...");
  command->add_option("--from", arguments->from, "compare the runs with this id or number …")
      ->type_name("ID");
  command
      ->add_option("--to", arguments->to,
                   "… with those, of the same file or of B; their conditions may differ")
      ->type_name("ID")
      ->excludes("--only");
  add_report_format(*command, arguments->format);
  add_output(*command, arguments->output);
  add_file(*command, "--plot", arguments->plot, "also a figure for a paper: .svg, .pdf or .png");
  auto flags = std::make_shared<GateFlags>(*command, gate::Use::fail_if_compared);
  command->callback(
      [&action, arguments, flags] { action = [arguments, flags] { return compare(*arguments, *flags); }; });
}

}  // namespace ontime::app

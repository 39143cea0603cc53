// SPDX-License-Identifier: Apache-2.0
#include "plot.hpp"

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <limits>
#include <map>
#include <memory>
#include <system_error>

#include <fmt/format.h>
#include <unistd.h>

#include "campaign/campaign.hpp"
#include "chosen_runs.hpp"
#include "commands.hpp"
#include "flags.hpp"
#include "gate/gate.hpp"
#include "output.hpp"
#include "process/process.hpp"
#include "terminal.hpp"

namespace ontime::app {
namespace {

using campaign::Error;
using plot::Plot;

struct PlotArguments {
  std::string results, output, figure = "time";
  std::vector<std::string> only;
  bool wide = false;
};

Plot plot_of(const PlotArguments& arguments) {
  using enum Plot::Figure;
  // Until 0.3, "worse" and "neighbours" are names, too.
  const auto& word = arguments.figure;
  const auto figure = word_flag<Plot::Figure>("--figure",
                                              word == "worse"        ? "ccdf"
                                              : word == "neighbours" ? "background"
                                                                     : word,
                                              {{"time", time},
                                               {"ccdf", ccdf},
                                               {"conditions", conditions},
                                               {"payload", payload},
                                               {"background", background}});
  return {figure, form_of("--output", arguments.output), arguments.wide};
}

constexpr std::size_t most_panels = 12;  // on one sheet of paper

int plot(PlotArguments arguments) {
  const bool is_named = !arguments.output.empty();
  if (const std::filesystem::path results(arguments.results); !is_named)  // beside them, as the page is
    arguments.output =
        fmt::format("{}-{}.svg", (results.parent_path() / results.stem()).string(), arguments.figure);
  const auto plot = plot_of(arguments);
  const record::Reader reader(arguments.results);
  Output output(arguments.output, Kind::figure);
  auto summaries = chosen_summaries(reader, arguments.results, arguments.only);
  std::vector<std::string> without;
  std::erase_if(summaries, [&](const auto& summary) {
    if (summary.sent == 0)
      without.push_back(
          fmt::format("{}: {}", gate::name_of(summary),
                      summary.imported ? "imported values have no messages" : "no message was sent"));
    return summary.sent == 0;
  });
  if (summaries.empty()) throw wrong("{}: no measured messages to draw", arguments.results);
  if (plot.figure == Plot::Figure::time && summaries.size() > most_panels)
    throw wrong("--figure time draws at most {} runs, but {} are selected. Fix: choose runs with --only",
                most_panels, summaries.size());
  if (plot.figure == Plot::Figure::background && std::ranges::none_of(summaries, [](const auto& summary) {
        return summary.run.asked.task.background.topics > 0;
      }))
    throw wrong("{}: none of its runs had background topics (key `background`)", arguments.results);
  const auto payload_of = [](const auto& summary) { return summary.run.asked.task.client.payload_bytes; };
  if (const auto payload = payload_of(summaries.front());
      plot.figure == Plot::Figure::payload &&
      std::ranges::all_of(summaries, [&](const auto& summary) { return payload_of(summary) == payload; }))
    throw wrong(
        "--figure payload compares payloads, but all runs have {} bytes. Fix: measure with several payloads "
        "(key `payload`)",
        payload);
  output.write(drawn(plot::gnuplot_of(summaries, plot)));
  output.finish();
  for (const auto& name : without) print_error("not drawn: " + name);
  for (const auto* run : plot::left_out(summaries, plot))
    print_error(fmt::format("not drawn: {}: {}", gate::name_of(*run), gate::unfit(*run)));
  if (!is_named) print_error("figure: " + arguments.output);
  return 0;
}

}  // namespace

Plot::Form form_of(const char* flag, const std::string& output) {
  const std::map<std::string, Plot::Form> forms = {
      {".svg", Plot::Form::svg}, {".pdf", Plot::Form::pdf}, {".png", Plot::Form::png}};
  const auto form = forms.find(std::filesystem::path(output).extension().string());
  if (form == forms.end()) throw wrong("{}: '{}' must end in .svg, .pdf or .png", flag, output);
  return form->second;
}

std::string drawn(const std::string& commands) {
  process::Memory script, figure;
  if (!script.hold(commands)) throw Error(3, "there is not enough memory for a figure");
  setenv("LC_ALL", "C.UTF-8", 1);  // gnuplot warns of characters that the locale lacks; NOLINT: one thread
  // --default-settings: not those of the user.
  const auto gnuplot = process::start({"gnuplot", "--default-settings"},
                                      {script.fd(), figure.fd(), STDERR_FILENO}, process::Group::callers);
  if (gnuplot.error == ENOENT) throw Error(3, "figures need gnuplot. Fix: sudo apt install gnuplot-nox");
  if (gnuplot.error != 0)
    throw Error(3, "gnuplot cannot be started: " + std::generic_category().message(gnuplot.error));
  const bool failed = process::wait_for(gnuplot.pid) != 0;
  auto text = figure.text(std::numeric_limits<off_t>::max());
  if (failed || text.empty())
    throw Error(
        3,
        "gnuplot could not draw the figure; its error is above. If `gnuplot --version` is 5.4 or later, "
        "report it with that error: it is a fault of ontime");
  return text;
}

void add_plot(Command& app) {
  auto* command = app.add_subcommand("plot", "Draws figures for a paper: SVG, PDF, PNG");
  auto arguments = std::make_shared<PlotArguments>();
  command->add_option("RESULTS", arguments->results, "a results file")->required();
  add_file(*command, "--output", arguments->output,
           "figure file: .svg, .pdf or .png (default: NAME-FIGURE.svg beside RESULTS)");
  command->add_option(
      "--figure", arguments->figure,
      "time (round trips over time), ccdf (exceedance), conditions (one row for each), payload (round "
      "trip by payload) or background (round trip by rate of background topics) (default: time)",
      "FIGURE");
  add_only(*command, arguments->only, ",--runs");
  command->add_flag("--wide", arguments->wide, "draw two columns wide, instead of one");
  command->calls([arguments] { return plot(*arguments); });
}

}  // namespace ontime::app

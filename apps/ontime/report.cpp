// SPDX-License-Identifier: Apache-2.0
#include "report/report.hpp"

#include <filesystem>
#include <optional>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "chosen_runs.hpp"
#include "commands.hpp"
#include "flags.hpp"
#include "gates.hpp"
#include "output.hpp"
#include "page/page.hpp"
#include "scenario_files.hpp"
#include "terminal.hpp"

namespace ontime::app {
namespace {

// Origin::running_from. Runs that a killed process left have another command line, or are measured again, or
// name their recorder. A recorder ends the runs of nodes that have gone.
std::optional<std::int64_t> running_from(const record::Reader& reader, bool is_being_written) {
  if (!is_being_written) return {};
  const auto runs = reader.runs();
  std::int64_t from = runs.empty() ? 1 : runs.back().number + 1;
  std::optional<std::int64_t> recorder;
  for (auto run = runs.rbegin();
       run != runs.rend() && run->asked.command_line == runs.back().asked.command_line; ++run) {
    if (run->outcome.has_ended() && run->asked.keeps_worst()) continue;
    if (run->outcome.has_ended()) break;
    if (!recorder) recorder = run->outcome.recorder_began_s;
    if (run->outcome.recorder_began_s && run->outcome.recorder_began_s != recorder) break;
    from = run->number;
  }
  return from;
}

}  // namespace

void add_report(Command& app) {
  auto* command =
      app.add_subcommand("report", "Shows a results file: summary, tables, or an HTML page with figures");
  struct Arguments {
    std::string results, format, output;
    std::vector<std::string> only;
    bool threads = false, layers = false, full = false;
  };
  auto arguments = std::make_shared<Arguments>();
  command->add_option("RESULTS", arguments->results, "a results file")->required();
  add_only(*command, arguments->only);
  add_report_format(*command, arguments->format, arguments->full);
  add_report_output(*command, arguments->output);
  command->add_flag("--threads", arguments->threads,
                    "show each thread as the kernel reports it, instead of times");
  command->add_flag("--layers", arguments->layers, "show the cost of each layer, for runs with a baseline")
      ->excludes("--threads");
  auto flags = std::make_shared<GateFlags>(*command, gate::Use::fail_if);
  command->calls([arguments, flags] {
    const auto format = format_flag(arguments->format, arguments->output);
    const auto gates = flags->gates();
    const bool is_being_written = record::is_being_written(arguments->results);  // before it is opened
    const record::Reader reader(arguments->results);
    Output output(arguments->output, kind_of(format));
    const auto running = running_from(reader, is_being_written);
    const auto summaries = chosen_summaries(reader, arguments->results, arguments->only);
    const auto drawn = [&] {
      Terminal terminal;
      terminal.does("drawing the page");
      return page::page_of(reader, summaries,
                           {.file = std::filesystem::path(arguments->results).filename().string(),
                            .trusts = is_trusted,
                            .running_from = running});
    };
    const auto text = arguments->threads  ? report::render_threads(summaries, format, output_columns())
                      : arguments->layers ? report::render_layers(summaries, format, output_columns())
                      : format == report::Format::html
                          ? drawn()
                          : shown(summaries, format, arguments->full,
                                  {.file = arguments->results,
                                   .only = fmt::format("{}", fmt::join(arguments->only, ",")),
                                   .running_from = running});
    // Before the text: a reader that closes the pipe (`| head`) ends this process.
    const int code = flags->finish(flags->judge_wanted(gates, summaries), arguments->results);
    output.write(text);
    output.finish();
    return code;
  });
}

}  // namespace ontime::app

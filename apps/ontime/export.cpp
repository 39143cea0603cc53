// SPDX-License-Identifier: Apache-2.0
#include <boost/algorithm/string/predicate.hpp>
#include <fmt/format.h>

#include "chosen_runs.hpp"
#include "commands.hpp"
#include "flags.hpp"
#include "output.hpp"
#include "report/report.hpp"

namespace ontime::app {
namespace {

struct ExportArguments {
  std::string results, format, output;
  std::vector<std::string> only;
};

// Without the flag, as the ending of the file says.
report::SampleFormat sample_format_flag(const std::string& word, const std::string& file) {
  using boost::algorithm::iends_with;
  if (word.empty() && iends_with(file, ".json"))
    throw wrong("--output: export writes CSV or JSON Lines, not JSON. Fix: name a .jsonl file");
  if (word.empty())
    return iends_with(file, ".jsonl") || iends_with(file, ".ndjson") ? report::SampleFormat::jsonl
                                                                     : report::SampleFormat::csv;
  if (word == "parquet" || word == "arrow")
    throw wrong(
        "--format: ontime does not write {}, because Debian 12 has no library for it. Fix: convert csv with "
        "pandas (docs/how-to/work-on-samples.md)",
        word);
  using report::SampleFormat;
  return word_flag<SampleFormat>("--format", word,
                                 {{"csv", SampleFormat::csv}, {"jsonl", SampleFormat::jsonl}});
}

int export_results(const ExportArguments& arguments) {
  const auto format = sample_format_flag(arguments.format, arguments.output);
  const record::Reader reader(arguments.results);
  const auto runs = chosen_runs(reader, arguments.results, arguments.only);
  Output output(arguments.output, format == report::SampleFormat::csv ? Kind::csv : Kind::json);
  report::export_samples(reader, runs, format, [&](std::string_view text) { output.write(text); });
  output.finish();
  return 0;
}

}  // namespace

void add_export(Command& app) {
  auto* command = app.add_subcommand("export", "Exports every sample of a results file as CSV or JSON Lines");
  auto arguments = std::make_shared<ExportArguments>();
  command->add_option("RESULTS", arguments->results, "a results file")->required();
  command->add_option("--format", arguments->format,
                      "csv or jsonl (default: as the file's ending says, else csv)", "FORMAT");
  add_only(*command, arguments->only, ",--run");
  add_output(*command, arguments->output);
  command->calls([arguments] { return export_results(*arguments); });
}

}  // namespace ontime::app

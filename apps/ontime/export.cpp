// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include <fmt/format.h>

#include "campaign/campaign.hpp"
#include "commands.hpp"
#include "flags.hpp"
#include "output.hpp"

namespace ontime::app {
namespace {

struct Arguments {
  std::string results, format = "csv", output;
  std::vector<std::int64_t> runs;
};

report::SampleFormat sample_format_flag(const std::string& word) {
  if (const auto format = report::sample_format_of(word)) return *format;
  if (word == "parquet" || word == "arrow")
    throw campaign::Error(
        2, fmt::format("--format: Debian 12 has no package that writes {}, so ontime does not; pandas "
                       "makes it of csv (docs/results-file.md)",
                       word));
  throw campaign::Error(2, fmt::format("--format: '{}' is not one of csv, jsonl", word));
}

std::vector<record::Run> chosen(std::vector<record::Run> runs, const std::vector<std::int64_t>& numbers) {
  for (const auto number : numbers)
    if (std::none_of(runs.begin(), runs.end(), [&](const auto& run) { return run.number == number; }))
      throw campaign::Error(2, fmt::format("--run: there is no run {}; there are {}", number, runs.size()));
  if (!numbers.empty())
    std::erase_if(runs, [&](const auto& run) {
      return std::find(numbers.begin(), numbers.end(), run.number) == numbers.end();
    });
  return runs;
}

int export_results(const Arguments& arguments) {
  const auto format = sample_format_flag(arguments.format);
  const record::Reader reader(arguments.results);
  const auto runs = chosen(reader.runs(), arguments.runs);
  Output output(arguments.output);
  report::export_samples(reader, runs, format, [&](std::string_view text) { output.write(text); });
  output.finish();
  return 0;
}

}  // namespace

void add_export(CLI::App& app, Action& action) {
  auto* command = app.add_subcommand("export", "Every sample of a results file, as CSV or JSON Lines");
  auto arguments = std::make_shared<Arguments>();
  command->add_option("RESULTS", arguments->results, "a results file")->required();
  command->add_option("--format", arguments->format, "csv or jsonl: csv")->type_name("FORMAT");
  command->add_option("--run", arguments->runs, "only these, by their numbers")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->type_name("N,...");
  add_output(*command, arguments->output);
  command->callback([&action, arguments] { action = [arguments] { return export_results(*arguments); }; });
}

}  // namespace ontime::app

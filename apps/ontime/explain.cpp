// SPDX-License-Identifier: Apache-2.0
#include "explain/explain.hpp"

#include <algorithm>
#include <optional>

#include <fmt/format.h>

#include "campaign/campaign.hpp"
#include "commands.hpp"
#include "flags.hpp"
#include "output.hpp"

namespace ontime::app {
namespace {

struct Arguments {
  std::string results, format = "table";
  std::optional<std::int64_t> run;
  std::optional<std::uint64_t> message;
};

report::Format format_of(const std::string& word) {
  const auto format = report::format_of(word);
  if (format != report::Format::table && format != report::Format::json && format != report::Format::markdown)
    throw campaign::Error(2, fmt::format("--format: '{}' is not one of table, json, markdown", word));
  return *format;
}

std::vector<record::Run> chosen(const record::Reader& reader, const std::optional<std::int64_t>& number) {
  auto runs = reader.runs();
  if (!number) return runs;
  std::erase_if(runs, [&](const auto& run) { return run.number != *number; });
  if (runs.empty()) throw campaign::Error(2, fmt::format("--run: there is no run {}", *number));
  return runs;
}

int explain(const Arguments& arguments) {
  const auto format = format_of(arguments.format);
  const record::Reader reader(arguments.results);
  const auto runs = chosen(reader, arguments.run);
  if (arguments.message && runs.size() > 1)
    throw campaign::Error(2, fmt::format("--message: of which of the {} runs? Say --run N too", runs.size()));
  std::vector<report::Explained> all;
  all.reserve(runs.size());
  for (const auto& run : runs) all.push_back({run, explain::account_of(reader, run)});
  Output output("");
  if (!arguments.message) {
    output.write(report::render_explained(all, format));
  } else {
    const auto& messages = all.at(0).account.messages;
    const auto found = std::find_if(messages.begin(), messages.end(), [&](const auto& message) {
      return message.sample.index == *arguments.message;
    });
    if (found == messages.end())
      throw campaign::Error(
          2, fmt::format(
                 "--message: of message {} it is not known what the kernel did; it is of {} of this run, the "
                 "worst (--format json lists them)",
                 *arguments.message, messages.size()));
    output.write(report::render_explained(all.front(), *found, format));
  }
  output.finish();
  return 0;
}

}  // namespace

void add_explain(CLI::App& app, Action& action) {
  auto* command = app.add_subcommand(
      "explain", "Why messages were late or lost, and what mends it, of runs with `explain: on`");
  auto arguments = std::make_shared<Arguments>();
  command->add_option("RESULTS", arguments->results, "a results file")->required();
  command->add_option("--run", arguments->run, "this run alone")->type_name("N");
  command->add_option("--message", arguments->message, "all of this message's delay, part by part")
      ->type_name("N");
  command->add_option("--format", arguments->format, "table, json or markdown: table")->type_name("FORMAT");
  command->callback([&action, arguments] { action = [arguments] { return explain(*arguments); }; });
}

}  // namespace ontime::app

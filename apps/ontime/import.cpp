// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include "campaign/campaign.hpp"
#include "commands.hpp"
#include "flags.hpp"
#include "foreign/foreign.hpp"
#include "terminal.hpp"

namespace ontime::app {
namespace {

struct ImportArguments {
  std::string file, from, results, id = "cyclictest", unit = "us";
};

foreign::What what_of(const ImportArguments& arguments) {
  const auto form = foreign::form_of(arguments.from);
  if (!form && arguments.from == "performance-test")
    throw campaign::Error(
        2,
        "--from: performance_test logs the least, mean and greatest latency of each second, and no "
        "message's own: no percentile and no late message could be told of it, so it is not "
        "imported");
  if (!form)
    throw campaign::Error(
        2, fmt::format("--from: '{}' is not one of cyclictest-histogram, cyclictest-json", arguments.from));
  if (arguments.unit != "us" && arguments.unit != "ns")
    throw campaign::Error(2, fmt::format("--unit: '{}' is neither us nor ns", arguments.unit));
  return {*form, arguments.id, arguments.unit == "us" ? 1000 : 1};
}

int import_results(const ImportArguments& arguments, const nlohmann::json& command_line) {
  const auto runs =
      foreign::read(arguments.file, what_of(arguments));  // all of it, before anything is written
  record::Writer writer(arguments.results);
  for (const auto& run : runs) {
    auto asked = run.asked;
    asked["ontime"] = ONTIME_VERSION;
    asked["command_line"] = command_line;
    writer.end_run(writer.begin_run(asked), run.outcome);
  }
  print_error(fmt::format("{} run{} of {} {} in {}", runs.size(), runs.size() == 1 ? "" : "s", arguments.file,
                          runs.size() == 1 ? "is" : "are", arguments.results));
  return 0;
}

}  // namespace

void add_import(Command& app, Action& action) {
  auto* command = app.add_subcommand("import", "What cyclictest measured, as runs of a results file");
  auto arguments = std::make_shared<ImportArguments>();
  command->add_option("FILE", arguments->file, "what cyclictest wrote, run with -h")->required();
  command->add_option("--from", arguments->from, "cyclictest-histogram (text) or cyclictest-json")
      ->type_name("FORM")
      ->required();
  add_file(*command, "--results", arguments->results, "add to this results file")->required();
  command->add_option("--id", arguments->id, "of the runs, by which they are compared: cyclictest")
      ->type_name("ID")
      ->check(given);
  command
      ->add_option("--unit", arguments->unit, "us or ns (cyclictest -N), which a histogram does not tell: us")
      ->type_name("UNIT");
  command->callback(
      [&action, arguments] { action = [arguments] { return import_results(*arguments, command_line()); }; });
}

}  // namespace ontime::app

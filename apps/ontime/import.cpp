// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include "commands.hpp"
#include "flags.hpp"
#include "foreign/foreign.hpp"
#include "listening.hpp"
#include "table/table.hpp"
#include "terminal.hpp"

namespace ontime::app {
namespace {

struct ImportArguments {
  ListenArguments bag;  // BAG and --results also serve cyclictest files
  std::string from, id = "cyclictest", unit = "us";
};

foreign::What what_of(const ImportArguments& arguments) {
  if (arguments.from == "performance-test")
    throw wrong(
        "--from: performance_test cannot be imported. It logs only the least, mean and greatest latency of "
        "each second; percentiles need every message");
  using foreign::Form;
  const auto form = word_flag<Form>(
      "--from", arguments.from,
      {{"cyclictest-histogram", Form::cyclictest_histogram}, {"cyclictest-json", Form::cyclictest_json}});
  const auto unit_ns = word_flag<int>("--unit", arguments.unit, {{"us", 1000}, {"ns", 1}});
  if (const auto flaw = conditions::flaw_of_id(arguments.id); !flaw.empty())
    throw wrong("--id: '{}': {}", arguments.id, flaw);
  return {form, arguments.id, unit_ns};
}

int import_results(const ImportArguments& arguments) {
  const auto runs =
      foreign::read(arguments.bag.bag, what_of(arguments));  // read completely before anything is written
  record::Writer writer(arguments.bag.results);
  for (const auto& run : runs) {
    auto asked = run.asked;
    asked["ontime"] = ONTIME_VERSION;
    asked["command_line"] = command_line();
    writer.end_run(writer.begin_run(asked), run.outcome);
  }
  print_error(fmt::format("added {} of {} to {}. Next: ontime report {}",
                          table::many(runs.size(), "run", "runs"), arguments.bag.bag, arguments.bag.results,
                          table::shell_line({table::as_operand(arguments.bag.results)})));
  return 0;
}

// Refuses flags that apply to the other kind of input only.
void refuse(const Command& command, std::initializer_list<const char*> flags, const char* why) {
  for (const auto& option : command.options())
    for (const auto* flag : flags)
      if (option.name() == flag && option.count() > 0) throw wrong("{}: {}", flag, why);
}

int import_file(const Command& command, const ImportArguments& arguments) {
  if (arguments.from.empty()) {
    refuse(command, {"--id", "--unit"},
           "applies to cyclictest files only. Fix: add --from, or omit this flag");
    return listen_to(arguments.bag);
  }
  refuse(command, {"--topic", "--deadline", "--period", "--age", "--format", "--output"},
         "applies to bags only. Fix: omit --from, or this flag");
  if (arguments.from == "cyclictest-json")
    refuse(command, {"--unit"},
           "applies to histograms only, because JSON states its unit. Fix: omit this flag");
  if (arguments.bag.results.empty()) throw wrong("--from needs --results FILE, the results file to add to");
  return import_results(arguments);
}

}  // namespace

void add_import(Command& app) {
  auto* command = app.add_subcommand(
      "import", "Checks the messages of a bag (rosbag2, MCAP), or imports results of cyclictest");
  auto arguments = std::make_shared<ImportArguments>();
  auto& bag = arguments->bag;
  command->add_option("BAG", bag.bag, "a rosbag2 folder, .db3 or .mcap file; with --from: a cyclictest file")
      ->required();
  add_value(*command, "--topic", bag.topics, "TOPIC", "only this topic; repeatable (default: all)")
      ->one_a_flag();
  add_limits(*command, bag, "a message is late if it is older than this when recorded");
  add_format(*command, bag.format);
  add_output(*command, bag.output);
  command->add_option("--from", arguments->from,
                      "format of a cyclictest file: cyclictest-histogram (text) or cyclictest-json", "FORM");
  add_results(*command, bag.results,
              "add runs to this results file; a bag adds one for each age and period of a topic");
  add_value(*command, "--id", arguments->id, "ID",
            "id of the cyclictest runs, for compare (default: cyclictest)");
  command->add_option("--unit", arguments->unit,
                      "unit of a histogram: us, or ns for cyclictest -N (default: us)", "UNIT");
  command->calls([command, arguments] { return import_file(*command, *arguments); });
}

}  // namespace ontime::app

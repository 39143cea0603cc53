// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include "campaign/campaign.hpp"
#include "commands.hpp"
#include "flags.hpp"
#include "foreign/foreign.hpp"
#include "listening.hpp"
#include "table/table.hpp"
#include "terminal.hpp"

namespace ontime::app {
namespace {

struct ImportArguments {
  ListenArguments bag;  // whose file and results are those of cyclictest, too
  std::string from, id = "cyclictest", unit = "us";
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
  if (const auto flaw = conditions::flaw_of_id(arguments.id); !flaw.empty())
    throw campaign::Error(2, fmt::format("--id: '{}': {}", arguments.id, flaw));
  return {*form, arguments.id, arguments.unit == "us" ? 1000 : 1};
}

int import_results(const ImportArguments& arguments) {
  const auto runs =
      foreign::read(arguments.bag.bag, what_of(arguments));  // all of it, before anything is written
  record::Writer writer(arguments.bag.results);
  for (const auto& run : runs) {
    auto asked = run.asked;
    asked["ontime"] = ONTIME_VERSION;
    asked["command_line"] = command_line();
    writer.end_run(writer.begin_run(asked), run.outcome);
  }
  print_error(fmt::format("{} of {} {} in {}", table::many(runs.size(), "run", "runs"), arguments.bag.bag,
                          runs.size() == 1 ? "is" : "are", arguments.bag.results));
  return 0;
}

// Of one form of input, given for the other.
void refuse(const Command& command, std::initializer_list<const char*> flags, const char* why) {
  for (const auto& option : command.options())
    for (const auto* flag : flags)
      if (option.name() == flag && option.count() > 0)
        throw campaign::Error(2, fmt::format("{}: {}", flag, why));
}

int import_file(const Command& command, const ImportArguments& arguments) {
  if (arguments.from.empty()) {
    refuse(command, {"--id", "--unit"}, "is for what cyclictest wrote, and needs --from");
    return listen_to(arguments.bag);
  }
  refuse(command, {"--topic", "--deadline", "--period", "--age", "--format", "--output"},
         "is for a bag; leave out --from, or this flag");
  if (arguments.from == "cyclictest-json")
    refuse(command, {"--unit"}, "is for a histogram; JSON says its unit");
  if (arguments.bag.results.empty()) throw campaign::Error(2, "--from needs --results, the file to add to");
  return import_results(arguments);
}

}  // namespace

void add_import(Command& app) {
  auto* command = app.add_subcommand(
      "import",
      "Judges the messages of a bag (rosbag2, MCAP), or adds what cyclictest measured to a results file");
  auto arguments = std::make_shared<ImportArguments>();
  auto& bag = arguments->bag;
  command
      ->add_option("BAG", bag.bag,
                   "a folder of rosbag2, a .db3 or a .mcap file; with --from, a file of cyclictest")
      ->required();
  add_value(*command, "--topic", bag.topics, "TOPIC", "judge this topic, once or more: all")
      ->allow_extra_args(false);
  add_limits(*command, bag, "a message is late that is older than this when it was recorded");
  add_format(*command, bag.format);
  add_output(*command, bag.output);
  command->add_option("--from", arguments->from, "cyclictest-histogram (text) or cyclictest-json")
      ->type_name("FORM");
  add_file(*command, "--results", bag.results,
           "add runs to this results file: of a bag, one for each age and period of a topic");
  add_value(*command, "--id", arguments->id, "ID",
            "of cyclictest's runs, by which they are compared: cyclictest");
  command
      ->add_option("--unit", arguments->unit, "us or ns (cyclictest -N), which a histogram does not tell: us")
      ->type_name("UNIT");
  command->calls([command, arguments] { return import_file(*command, *arguments); });
}

}  // namespace ontime::app

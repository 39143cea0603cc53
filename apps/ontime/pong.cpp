// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <fmt/ranges.h>

#include "campaign/campaign.hpp"
#include "commands.hpp"
#include "flags.hpp"
#include "run_flags.hpp"
#include "table/table.hpp"
#include "terminal.hpp"

namespace ontime::app {
namespace {

void print_opened(const record::Transport& transport) {
  const auto facts = table::texts_of(
      transport.facts, [](const auto& fact) { return fmt::format("{} {}", fact.first, fact.second); });
  print_error(fmt::format("pong answers over {} ({}): {}. Ctrl-C ends it.", transport.name, transport.version,
                          fmt::join(facts, ", ")));
}

// One run for each ping, without samples: ping has them.
void write(record::Writer& writer, const campaign::Run& run, const campaign::Served& served) {
  auto asked = campaign::asked(run, {});
  asked["id"] = "pong";
  asked["command_line"] = command_line();
  for (const auto& windows : served.pings) {
    const auto number = writer.begin_run(asked);
    for (const auto& window : windows) writer.trace(number, {"component", window});
    writer.end_run(number, record::to_json(served.outcome));
  }
}

}  // namespace

void add_pong(Command& app) {
  auto* command = app.add_subcommand("pong", "Runs the server: replies to ping's messages until Ctrl-C");
  auto flags = std::make_shared<RunFlags>(*command, campaign::Key::For::both);
  auto results = std::make_shared<std::string>();
  add_results(*command, *results,
              "with --explain: keep the traces in this file, for `ontime explain --pong`");
  command->calls([flags, results] {
    const auto run = flags->run();
    if (run.explain == results->empty())
      throw campaign::Error(2, run.explain ? "--explain needs --results FILE, where pong keeps its traces"
                                           : "--results needs --explain: without it, pong records nothing");
    std::optional<record::Writer> writer;
    if (run.explain) writer.emplace(*results);
    Terminal terminal;
    campaign::Served served;
    int code = 0;
    const auto keep = [&] {
      if (writer) write(*writer, run, served);
    };
    try {
      code = campaign::pong(
          run, terminal, catch_interrupts(),
          [](const record::Host& opened) {
            print_opened(opened.transport);
            for (const auto& text : report::refusals_of(opened)) print_own_lines(text);
          },
          served);
    } catch (...) {
      keep();
      throw;
    }
    keep();
    if (served.answered) print("answered " + table::many(*served.answered, "message", "messages") + "\n");
    return was_stopped() ? 0 : code;  // a service that is stopped has not failed
  });
}

}  // namespace ontime::app

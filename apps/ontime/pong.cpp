// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <fmt/ranges.h>

#include "campaign/campaign.hpp"
#include "commands.hpp"
#include "flags.hpp"
#include "run_flags.hpp"
#include "terminal.hpp"

namespace ontime::app {
namespace {

using nlohmann::json;

void print_opened(const json& opened) {
  const auto& transport = opened.at("transport");
  std::vector<std::string> facts;
  for (const auto& [name, value] : transport.at("facts").items())
    facts.push_back(fmt::format("{} {}", name, value.get<std::string>()));
  print_error(fmt::format("pong answers over {} ({}): {}. Ctrl-C ends it.",
                          transport.at("name").get<std::string>(), transport.at("version").get<std::string>(),
                          fmt::join(facts, ", ")));
}

// One run for each ping, without samples: ping has them.
void write(record::Writer& writer, const campaign::Run& run, const json& closed) {
  auto asked = campaign::asked(run, {});
  asked["id"] = "pong";
  asked["command_line"] = command_line();
  for (const auto& windows : closed.at("pings")) {
    const auto number = writer.begin_run(asked);
    for (const auto& window : windows) writer.trace(number, {"component", trace::window_of(window)});
    writer.end_run(
        number,
        {{"trace", {{"component", closed.at("trace")}}},
         {"hosts", {{"component", {{"threads", closed.at("threads")}, {"machine", closed.at("machine")}}}}}});
  }
}

}  // namespace

void add_pong(Command& app) {
  auto* command = app.add_subcommand("pong", "Runs the server: replies to ping's messages until Ctrl-C");
  auto flags = std::make_shared<RunFlags>(*command, campaign::Key::For::both);
  auto results = std::make_shared<std::string>();
  add_file(*command, "--results", *results,
           "with --explain: keep the traces in this file, for `ontime explain --pong`");
  command->calls([flags, results] {
    const auto run = flags->run();
    if (run.explain == results->empty())
      throw campaign::Error(2, run.explain ? "--explain needs --results FILE, where pong keeps its traces"
                                           : "--results needs --explain: without it, pong records nothing");
    std::optional<record::Writer> writer;
    if (run.explain) writer.emplace(*results);
    Terminal terminal;
    json closed;
    int code = 0;
    const auto keep = [&] {
      if (writer && closed.contains("pings")) write(*writer, run, closed);
    };
    try {
      code = campaign::pong(
          run, terminal, catch_interrupts(),
          [](const json& opened) {
            print_opened(opened);
            for (const auto& text : report::refusals_of(record::host_of(opened))) print_error(text);
          },
          closed);
    } catch (...) {
      keep();
      throw;
    }
    keep();
    if (closed.contains("answered"))
      print(fmt::format("answered {} messages\n", closed.at("answered").get<std::uint64_t>()));
    return was_stopped() ? 0 : code;  // a service that is stopped has not failed
  });
}

}  // namespace ontime::app

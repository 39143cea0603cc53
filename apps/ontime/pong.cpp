// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <fmt/ranges.h>

#include "campaign/campaign.hpp"
#include "commands.hpp"
#include "run_flags.hpp"
#include "terminal.hpp"

namespace ontime::app {
namespace {

using nlohmann::json;

void print_refusals(const json& opened) {
  for (const auto& text : report::refusals_of(opened)) print_error(text);
}

void print_opened(const json& opened) {
  const auto& transport = opened.at("transport");
  std::vector<std::string> facts;
  for (const auto& [name, value] : transport.at("facts").items())
    facts.push_back(fmt::format("{} {}", name, value.get<std::string>()));
  print_error(fmt::format("pong answers over {} ({}): {}. Ctrl-C ends it.",
                          transport.at("name").get<std::string>(), transport.at("version").get<std::string>(),
                          fmt::join(facts, ", ")));
}

}  // namespace

void add_pong(CLI::App& app, Action& action) {
  auto* command =
      app.add_subcommand("pong", "The server's end: answers pings that come and go, until interrupted");
  auto flags = std::make_shared<RunFlags>(*command, campaign::Key::For::both);
  command->callback([&action, flags] {
    action = [flags] {
      const auto run = flags->run();
      json closed;
      const int code = campaign::pong(
          run, catch_interrupts(),
          [](const json& opened) {
            print_opened(opened);
            print_refusals(opened);
          },
          closed);
      if (closed.contains("answered"))
        print(fmt::format("answered {} messages\n", closed.at("answered").get<std::uint64_t>()));
      return was_stopped() ? 0 : code;  // a service that is stopped has not failed
    };
  });
}

}  // namespace ontime::app

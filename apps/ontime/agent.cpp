// SPDX-License-Identifier: Apache-2.0
#include "agent/agent.hpp"

#include "commands.hpp"

namespace ontime::app {

void add_agent(CLI::App& app, Action& action) {
  app.add_subcommand(
         "agent", "One end of one run, ordered over standard input and output; started by run, ping and pong")
      ->callback([&action] { action = agent::serve; });
}

}  // namespace ontime::app

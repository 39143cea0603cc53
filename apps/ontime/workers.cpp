// SPDX-License-Identifier: Apache-2.0
#include "agent/agent.hpp"
#include "commands.hpp"
#include "keeper/keeper.hpp"

namespace ontime::app {

void add_workers(Command& app, Action& action) {
  const auto add = [&](const char* name, const char* what, int (*serve)()) {
    app.add_subcommand(name, what)->group("")->callback([&action, serve] { action = serve; });
  };
  add("agent", "One end of one run; started by run, ping and pong", agent::serve);
  add("keeper", "What belongs to a machine; started by run and ping", keeper::serve);
}

}  // namespace ontime::app

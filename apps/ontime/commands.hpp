// SPDX-License-Identifier: Apache-2.0
// The subcommands: each adds itself to the command line, and says what to do when it is the one called.
#pragma once

#include <functional>

#include "command.hpp"

namespace ontime::app {

using Action = std::function<int()>;  // returns the exit code

void add_ping(Command&, Action&);
void add_pong(Command&, Action&);
void add_run(Command&, Action&);
void add_scenarios(Command&, Action&);
void add_init(Command&, Action&);
void add_watch(Command&, Action&);
void add_listen(Command&, Action&);
void add_report(Command&, Action&);
void add_compare(Command&, Action&);
void add_explain(Command&, Action&);
void add_export(Command&, Action&);
void add_import(Command&, Action&);
void add_plot(Command&, Action&);
void add_check(Command&, Action&);
void add_tune(Command&, Action&);
void add_tune_search(Command& tune, Action&);
void add_lab(Command&, Action&);
void add_completion(Command&, Action&);  // for bash and zsh
void add_workers(Command&, Action&);     // what the others start, by orders over standard input and output

// What to do next on this machine, for a user who named no command. Returns the exit code.
int show_next();

}  // namespace ontime::app

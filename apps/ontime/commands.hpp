// SPDX-License-Identifier: Apache-2.0
// The subcommands: each adds itself to the command line, and says what to do when it is the one called.
#pragma once

#include "command.hpp"

namespace ontime::app {

// The end of --help, of every command that states no codes of its own.
inline constexpr const char* exit_codes =
    "Exit codes: 0 OK · 1 a stated requirement was missed · 2 invalid usage or input · 3 this machine or a "
    "peer cannot do it · 130 interrupted";

void add_ping(Command&);
void add_pong(Command&);
void add_run(Command&);
void add_scenarios(Command&);
void add_init(Command&);
void add_watch(Command&);
void add_listen(Command&);
void add_report(Command&);
void add_compare(Command&);
void add_explain(Command&);
void add_export(Command&);
void add_import(Command&);
void add_plot(Command&);
void add_check(Command&);
void add_tune(Command&);
void add_tune_search(Command& tune);
void add_lab(Command&);
void add_completion(Command&);  // for bash and zsh

// What to do next on this machine, for a user who named no command. Returns the exit code.
int show_next();

}  // namespace ontime::app

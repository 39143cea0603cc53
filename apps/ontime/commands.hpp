// SPDX-License-Identifier: Apache-2.0
// The subcommands: each adds itself to the command line, and says what to do when it is the one called.
#pragma once

#include <functional>

#include <CLI/CLI.hpp>

namespace ontime::app {

using Action = std::function<int()>;  // returns the exit code

void add_ping(CLI::App&, Action&);
void add_pong(CLI::App&, Action&);
void add_run(CLI::App&, Action&);
void add_scenarios(CLI::App&, Action&);
void add_watch(CLI::App&, Action&);
void add_report(CLI::App&, Action&);
void add_compare(CLI::App&, Action&);
void add_explain(CLI::App&, Action&);
void add_export(CLI::App&, Action&);
void add_import(CLI::App&, Action&);
void add_plot(CLI::App&, Action&);
void add_check(CLI::App&, Action&);
void add_tune(CLI::App&, Action&);
void add_lab(CLI::App&, Action&);
void add_completion(CLI::App&, Action&);  // for bash and zsh
void add_workers(CLI::App&, Action&);     // what the others start, by orders over standard input and output

}  // namespace ontime::app

// SPDX-License-Identifier: Apache-2.0
#include <csignal>
#include <exception>
#include <utility>
#include <vector>

#include "commands.hpp"
#include "orders/orders.hpp"
#include "output.hpp"
#include "record/record.hpp"
#include "scenario/scenario.hpp"
#include "terminal.hpp"

int main(int argc, char** argv) {
  ontime::app::Program program("ontime",
                               "Do a robot's messages arrive on time, under the load that it really has?",
                               "ontime " ONTIME_VERSION);
  auto& app = program.command();
  app.require_subcommand()->footer(
      "Exit codes: 0 fine · 1 a stated requirement was missed · 2 wrong usage or input · 3 this machine or a "
      "peer cannot do what was asked · 130 interrupted");

  ontime::app::Action action;
  const std::pair<const char*, std::vector<void (*)(ontime::app::Command&, ontime::app::Action&)>> groups[] =
      {{"Measure",
        {ontime::app::add_run, ontime::app::add_ping, ontime::app::add_pong, ontime::app::add_listen,
         ontime::app::add_watch, ontime::app::add_scenarios, ontime::app::add_init}},
       {"Understand",
        {ontime::app::add_report, ontime::app::add_compare, ontime::app::add_explain, ontime::app::add_plot,
         ontime::app::add_export, ontime::app::add_import}},
       {"Tune", {ontime::app::add_check, ontime::app::add_tune}},
       {"Try", {ontime::app::add_lab}},
       {"Set up", {ontime::app::add_completion}}};
  for (const auto& [group, commands] : groups)
    for (const auto add : commands) {
      add(app, action);
      app.subcommands().back()->group(group);
    }
  ontime::app::add_workers(app, action);
  const auto failed = [](int code, const char* message) {
    ontime::app::print_error(message);
    return code;
  };
  try {
    if (argc == 1)
      action = ontime::app::show_next;
    else if (const auto code = program.parse(argc, argv))
      return *code;
    return action();
  } catch (const ontime::orders::Error& error) {
    return failed(error.exit, error.what());
  } catch (const ontime::scenario::Error& error) {
    return failed(2, error.what());
  } catch (const ontime::app::ReaderGone&) {
    std::signal(SIGPIPE, SIG_DFL);
    std::raise(SIGPIPE);
    return 128 + SIGPIPE;  // where it is blocked
  } catch (const ontime::record::WrongFile& error) {
    return failed(2, error.what());
  } catch (const std::exception& error) {
    return failed(3, error.what());
  }
}

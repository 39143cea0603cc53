// SPDX-License-Identifier: Apache-2.0
#include <csignal>
#include <exception>
#include <filesystem>
#include <utility>
#include <vector>

#include "agent/agent.hpp"
#include "commands.hpp"
#include "keeper/keeper.hpp"
#include "orders/orders.hpp"
#include "output.hpp"
#include "record/record.hpp"
#include "scenario/scenario.hpp"
#include "terminal.hpp"

int main(int argc, char** argv) {
  using namespace ontime::app;
  // A file's largest size shows where it is written: a killed process would leave settings and files.
  std::signal(SIGXFSZ, SIG_IGN);
  Program program("ontime",
                  "Measures whether a robot's messages arrive on time under load, and explains late ones",
                  "ontime " ONTIME_VERSION);
  auto& app = program.command();
  app.require_subcommand();
  app.footer(exit_codes);

  const std::pair<const char*, std::vector<void (*)(Command&)>> groups[] = {
      {"Measure", {add_run, add_ping, add_pong, add_listen, add_watch, add_scenarios, add_init}},
      {"Understand", {add_report, add_compare, add_explain, add_plot, add_export, add_import}},
      {"Tune", {add_check, add_tune}},
      {"Try", {add_lab}},
      {"Set up", {add_completion}}};
  for (const auto& [group, commands] : groups)
    for (const auto add : commands) {
      add(app);
      app.subcommands().back()->group(group);
    }
  // Hidden commands: other commands start them, and send orders over standard input.
  const auto add_worker = [&](const char* name, const char* what, int (*serve)()) {
    app.add_subcommand(name, what)->group("")->calls(serve);
  };
  add_worker("agent", "One end of one run; started by run, ping and pong", ontime::agent::serve);
  add_worker("keeper", "Settings and load of one machine; started by run and ping", ontime::keeper::serve);
  const auto failed = [](int code, const std::string& message) {
    print_error(message);
    return code;
  };
  try {
    return argc == 1 ? show_next() : program.parse(argc, argv)();
  } catch (const ontime::orders::Error& error) {
    return failed(error.exit, error.what());
  } catch (const ontime::scenario::Error& error) {
    return failed(2, error.what());
  } catch (const ReaderGone&) {
    std::signal(SIGPIPE, SIG_DFL);
    std::raise(SIGPIPE);
    return 128 + SIGPIPE;  // if SIGPIPE is blocked
  } catch (const ontime::record::WrongFile& error) {
    return failed(2, error.what());
  } catch (const std::filesystem::filesystem_error& error) {
    std::error_code none;
    return std::filesystem::current_path(none).empty()
               ? failed(2, "the current folder was removed. Fix: cd to another")
               : failed(3, ontime::orders::words_of(error));
  } catch (const std::exception& error) {
    return failed(3, ontime::orders::words_of(error));
  }
}

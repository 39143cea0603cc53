// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include <fmt/format.h>

#include "campaign/campaign.hpp"
#include "commands.hpp"
#include "flags.hpp"
#include "measured.hpp"
#include "output.hpp"
#include "run_flags.hpp"
#include "statistics/statistics.hpp"
#include "terminal.hpp"

namespace ontime::app {

void add_ping(Command& app) {
  auto* command = app.add_subcommand(
      "ping", "Runs the client: sends messages on a schedule, and measures their round trips");
  struct Arguments {
    std::string wait = "10 s", results, format = "table";
    bool loopback = false, full = false;
  };
  auto flags = std::make_shared<RunFlags>(*command, campaign::Key::For::client);
  auto arguments = std::make_shared<Arguments>();
  command->add_option("--wait", arguments->wait, "how long to wait for pong (default: 10 s)", "TIME");
  command
      ->add_flag("--loopback", arguments->loopback,
                 "also start pong on this machine; no second terminal is needed")
      ->excludes("--peer")
      ->excludes("--interface")
      ->excludes("--wait");
  add_results(*command, arguments->results, "keep every sample in this file");
  add_report_format(*command, arguments->format, arguments->full);
  command->calls([flags, arguments] {
    const auto run = flags->run();
    const auto wait = duration_flag("--wait", arguments->wait);
    const auto format = format_flag(arguments->format);
    const bool keeps_no_traces = run.explain && arguments->results.empty();
    if (keeps_no_traces && !is_for_people(format))
      throw wrong(
          "--explain with --format {} needs --results FILE, where the traces are kept for `ontime explain`",
          arguments->format);
    auto& interrupts = catch_interrupts();
    record::Writer writer(arguments->results);
    const auto known = writer.reader().runs().size();
    Terminal terminal;
    campaign::Scenario on_loopback;
    on_loopback.hosts.kind = campaign::Hosts::Kind::loopback;
    on_loopback.runs = {run};
    const int code = arguments->loopback
                         ? campaign::execute(on_loopback, writer, terminal, interrupts, command_line())
                         : campaign::ping(run, wait, writer, terminal, interrupts, command_line());
    // Also shows what a failed run measured. Without a pong there is no run. Where nothing was sent,
    // the error has said all.
    const auto measured = statistics::summarise(writer.reader(), known);
    const bool is_said = (code == 2 || code == 3) && is_for_people(format) &&
                         std::ranges::all_of(measured, [](const auto& one) { return one.sent == 0; });
    if (!measured.empty() && !is_said)
      print(shown(measured, format, arguments->full, {.file = arguments->results, .is_own = true}));
    if (keeps_no_traces || (arguments->full && is_for_people(format))) explain_new(writer, known, format);
    return code;
  });
}

}  // namespace ontime::app

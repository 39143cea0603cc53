// SPDX-License-Identifier: Apache-2.0
// Output of `ontime` without a command: the next steps on this machine.
#include <algorithm>
#include <filesystem>
#include <iterator>
#include <system_error>

#include <fmt/format.h>

#include "commands.hpp"
#include "fitness/fitness.hpp"
#include "output.hpp"
#include "realtime/privileges.hpp"
#include "realtime/realtime.hpp"
#include "table/table.hpp"
#include "terminal.hpp"
#include "transport/shipped.hpp"
#include "transport/transport.hpp"

namespace ontime::app {
namespace {

namespace fs = std::filesystem;

// The newest results file in this folder; "": none.
std::string newest_results() {
  std::string newest;
  fs::file_time_type newest_time{};
  std::error_code none;
  for (const auto& entry : fs::directory_iterator(".", none)) {
    if (entry.path().extension() != ".ontime" || !entry.is_regular_file(none) || !is_results(entry.path()))
      continue;
    const auto name = entry.path().filename().string();
    if (table::printable(name) != name) continue;  // it would control the terminal
    const auto time = entry.last_write_time(none);
    if (none || (!newest.empty() && time <= newest_time)) continue;
    newest = table::as_operand(name);
    newest_time = time;
  }
  return newest;
}

}  // namespace

int show_next() {
  const auto transports = transport::available();
  const auto* shipped =
      std::ranges::find_first_of(transport::all_shipped, transports, {}, &transport::Shipped::name);
  const auto columns = reading_columns();
  auto text = table::wrapped("Do a robot's messages arrive on time? Next steps on this machine:", columns);
  const auto add = [&](const std::string& command, const std::string& what) {
    // The command stays whole, to be copied.
    if (columns < table::fewest_for_two)
      text += fmt::format("  {}\n{}", command, table::wrapped("    " + what, columns, "    "));
    else
      text += fmt::format("  {:<42}  {}\n", command, what);
  };
  if (const auto results = newest_results(); !results.empty())
    add("ontime report " + table::shell_line({results}), "the newest results in this folder");
  if (transports.empty()) shipped = transport::all_shipped;
  add(fmt::format("ontime ping --transport {} --loopback",
                  shipped == std::end(transport::all_shipped) ? transports.front() : shipped->name),
      // Without any, ping names the folders where ontime looks for them.
      transports.empty() ? "no transport is installed: see why" : "first round trips, 10 s");
  add("ontime check", "machine: " + fitness::counts_of(fitness::check({})));
  const auto own = realtime::privileges();
  const bool needs_sudo = !own.is_root() && realtime::how_to_be_root_in_container(own).empty();
  add(needs_sudo ? "sudo ontime run demo" : "ontime run demo", needs_sudo || realtime::may_use_fifo(1)
                                                                   ? "with load and real-time settings"
                                                                   : "with load; real-time is denied");
  add("ontime init ROBOT", "write a scenario for two machines");
  add("source <(ontime completion bash)", "complete commands with Tab");
  add("ontime --help", "all commands");
  print(text);
  return 0;
}

}  // namespace ontime::app

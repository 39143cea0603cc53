// SPDX-License-Identifier: Apache-2.0
#include "watch/watch.hpp"

#include <algorithm>
#include <sstream>
#include <thread>

#include <fmt/format.h>
#include <sys/resource.h>
#include <unistd.h>

#include "commands.hpp"
#include "flags.hpp"
#include "output.hpp"
#include "table/table.hpp"
#include "terminal.hpp"

namespace ontime::app {
namespace {

using namespace std::chrono_literals;

struct WatchArguments {
  std::string results, format = "table", metrics;
};

// Redraws in place on a terminal; otherwise prints only the last state.
class Screen {
 public:
  void show(const std::string& text, bool last) {
    if (interactive_ || last) print(up() + text);
    shown_ = for_output(text);
  }

 private:
  // The terminal breaks a long line, and may be wider or narrower than it was.
  std::string up() const {
    const auto columns = output_columns();
    std::size_t rows = 0;
    std::istringstream lines(shown_);
    for (std::string line; std::getline(lines, line);)
      rows += std::max<std::size_t>((table::width_of(line) + columns - 1) / columns, 1);
    return interactive_ && rows > 0 ? fmt::format("\033[{}A\033[J", rows) : "";
  }
  const bool interactive_ = isatty(STDOUT_FILENO) != 0;
  std::string shown_;
};

// A program that fetched metrics before gets the last ones, too. Prometheus fetches once a minute, if not
// more often.
void hand_over_last(watch::Metrics& metrics, const campaign::Interrupts& interrupts) {
  if (interrupts > 0 || !metrics.is_awaited()) return;
  metrics.end();
  print_error("waiting until the last metrics are fetched, for at most a minute (Ctrl-C: leave)");
  const auto until = std::chrono::steady_clock::now() + 1min;
  while (interrupts == 0 && metrics.is_awaited() && std::chrono::steady_clock::now() < until)
    std::this_thread::sleep_for(100ms);
}

int follow(const WatchArguments& arguments) {
  const bool as_json = is_json_flag(arguments.format);
  auto& interrupts = catch_interrupts();
  ::setpriority(PRIO_PROCESS, 0, 19);  // measuring comes first; the metrics thread inherits it
  const auto metrics = metrics_at(arguments.metrics);
  watch::Follower follower(arguments.results);
  Screen screen;
  while (true) {
    const auto& progress = follower.look();
    const bool interrupted = interrupts > 0;
    const bool last = interrupted || progress.state == watch::Progress::State::ended;
    if (as_json)
      print(watch::json_of(progress));
    else
      screen.show(watch::text_of(progress), last);
    if (metrics && !interrupted) metrics->set(watch::metrics_of(progress, follower.before()));
    if (last && metrics) hand_over_last(*metrics, interrupts);
    if (last) return interrupted ? 130 : 0;
    if (!follower.has_next()) std::this_thread::sleep_for(1s);
  }
}

}  // namespace

void add_watch(Command& app) {
  auto* command =
      app.add_subcommand("watch", "Follows a running measurement from another terminal until it ends");
  auto arguments = std::make_shared<WatchArguments>();
  command->add_option("RESULTS", arguments->results, "results file of the measurement")->required();
  command->add_option("--format", arguments->format, "table, or json: one object per second (default: table)",
                      "FORMAT");
  add_metrics(*command, arguments->metrics);
  command->calls([arguments] { return follow(*arguments); });
}

}  // namespace ontime::app

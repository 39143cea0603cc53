// SPDX-License-Identifier: Apache-2.0
#include "terminal.hpp"

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <sstream>
#include <string_view>
#include <system_error>
#include <utility>

#include <fmt/format.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include "gate/gate.hpp"
#include "output.hpp"
#include "table/table.hpp"

namespace ontime::app {
namespace {

campaign::Interrupts interrupts{0};
volatile std::sig_atomic_t last_signal = 0;
std::atomic<const char*> first_notice{nullptr};  // at the first signal
static_assert(std::atomic<const char*>::is_always_lock_free, "a signal handler reads it");

double seconds(std::chrono::nanoseconds time) { return std::chrono::duration<double>(time).count(); }

bool can_rewrite_a_line() {
  const char* const terminal = std::getenv("TERM");  // NOLINT(concurrency-mt-unsafe): no thread sets it
  return isatty(STDERR_FILENO) != 0 && terminal != nullptr && std::string_view(terminal) != "dumb";
}

std::size_t columns() {
  winsize size{};
  return ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 1 ? size.ws_col : 80;
}

std::string words(const roundtrip::Counters& counters) {
  // Only the report computes whether the reply that a skipped cycle waited for was in time.
  return fmt::format("{} late, {} lost, {} skipped of {} cycles", counters.late, counters.lost,
                     counters.skipped_cycles, counters.sent + counters.skipped_cycles);
}

// Ignores write errors: a full disk under a log must not stop a measurement.
template <typename... Arguments>
void say(fmt::format_string<Arguments...> text, Arguments&&... arguments) {
  std::fputs(for_terminal(fmt::format(text, std::forward<Arguments>(arguments)...), STDERR_FILENO).c_str(),
             stderr);
  std::fflush(stderr);
}

// Text from elsewhere (a type name from the network, another machine's words) must not control the terminal.
// Further lines are indented, so that only the first looks like a line of ontime.
std::string lines_of(const std::string& text) {
  std::istringstream lines(text);
  std::string result;
  for (std::string line; std::getline(lines, line);)
    result += (result.empty() ? "" : "\n  ") + table::printable(line);
  return result;
}

}  // namespace

Terminal::Terminal() : interactive_(can_rewrite_a_line()) {}

void Terminal::clear_line() {
  if (line_open_) say("\r\033[K");
  line_open_ = false;
}

// Cut to the terminal's width: a second line could not be cleared.
void Terminal::rewrite_line(const std::string& text) {
  clear_line();
  say("{:.{}}", for_terminal(text, STDERR_FILENO), columns() - 1);
  line_open_ = true;
}

void Terminal::note(const std::string& text) {
  clear_line();
  say("ontime: {}\n", lines_of(text));
}

void Terminal::line(const std::string& text) {
  clear_line();
  say("{}\n", table::printable(text));
}

void Terminal::waits(const std::string& text) {
  if (interactive_) rewrite_line(table::printable(text));
}

void Terminal::expect(std::size_t runs, std::chrono::duration<double> time, const std::string& kind) {
  runs_ = runs;
  left_ = time;
  kind_of_time_ = kind;
}

std::string Terminal::next(const campaign::Run& run) {
  ++number_;
  const auto count =
      runs_ > 1 ? fmt::format("[{}/{}, {}{} left] ", number_, runs_, about(left_), kind_of_time_) : "";
  left_ -= campaign::time_of(run);
  const auto repetition = run.repetition > 1 ? fmt::format(" #{}", run.repetition) : "";
  const auto variant = run.variant.empty() ? "" : " " + run.variant;
  return table::printable(fmt::format("{}{}{} {}{}", count, table::shortened(run.id, gate::longest_id),
                                      variant, run.task.transport, repetition));
}

void Terminal::begins(const campaign::Run& run) {
  head_ = next(run);
  duration_ = run.task.client.duration;
  if (!interactive_) return;
  rewrite_line(head_ + " …");
}

void Terminal::passes_over(const campaign::Run& run) {
  clear_line();
  say("{}  skipped (already in results)\n", next(run));
}

void Terminal::leaves_out(const campaign::Run& run) { next(run); }

void Terminal::progress(const roundtrip::Counters& counters, std::chrono::nanoseconds elapsed) {
  if (!interactive_) return;
  rewrite_line(
      fmt::format("{}  {:.0f}/{:g} s  {}", head_, seconds(elapsed), seconds(duration_), words(counters)));
}

void Terminal::ends(const roundtrip::Counters& counters) {
  clear_line();
  say("{}  {}\n", head_, words(counters));
}

campaign::Interrupts& catch_interrupts(const std::string& text) {
  static std::string kept;  // for the handler
  first_notice = nullptr;
  // On a terminal ^C stands on the line.
  kept = fmt::format("{}ontime: {}\n", isatty(STDERR_FILENO) != 0 ? "\n" : "",
                     for_terminal(text, STDERR_FILENO));
  if (!text.empty()) first_notice = kept.c_str();
  orders::on_termination([](int signal) {
    last_signal = signal;
    orders::count_termination(interrupts, signal);
    const int error = errno;
    // Output that stands still must not hold up the thread that the signal found.
    pollfd out{STDERR_FILENO, POLLOUT, 0};
    if (const char* const first = first_notice.exchange(nullptr);
        first != nullptr && poll(&out, 1, 0) == 1 && (out.revents & POLLOUT) != 0) {
      [[maybe_unused]] const auto written = ::write(STDERR_FILENO, first, std::strlen(first));
    }
    errno = error;
  });
  return interrupts;
}

bool was_stopped() { return last_signal == SIGTERM || (last_signal == 0 && interrupts > 0); }

nlohmann::json command_line() {
  auto words = nlohmann::json::array();
  std::ifstream arguments("/proc/self/cmdline");
  for (std::string word; std::getline(arguments, word, '\0');) words.push_back(word);
  return words;
}

void print(const std::string& text) {
  std::fputs(for_output(text).c_str(), stdout);
  // A closed terminal is an interruption, which is already counted.
  if ((std::fflush(stdout) != 0 || std::ferror(stdout) != 0) && interrupts == 0)
    throw campaign::Error(3, "standard output cannot be written: " + std::generic_category().message(errno));
}

void print_error(const std::string& text) { say("ontime: {}\n", lines_of(text)); }

}  // namespace ontime::app

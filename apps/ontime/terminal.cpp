// SPDX-License-Identifier: Apache-2.0
#include "terminal.hpp"

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <condition_variable>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <mutex>
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
#include "process/process.hpp"
#include "table/table.hpp"

namespace ontime::app {
namespace {

campaign::Interrupts interrupts{0};
volatile std::sig_atomic_t last_signal = 0;
std::atomic<const char*> first_notice{nullptr};  // at the first signal
static_assert(std::atomic<const char*>::is_always_lock_free, "a signal handler reads it");

// The line of progress, of which a process has one, and what it shows.
std::mutex line_mutex;
bool line_is_open = false;

double seconds(std::chrono::nanoseconds time) { return std::chrono::duration<double>(time).count(); }

bool can_rewrite_a_line() {
  const char* const terminal = std::getenv("TERM");  // NOLINT(concurrency-mt-unsafe): no thread sets it
  return isatty(STDERR_FILENO) != 0 && terminal != nullptr && std::string_view(terminal) != "dumb";
}

std::size_t columns() {
  winsize size{};
  return ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 1 ? size.ws_col : 80;
}

// Only the report computes how many cycles had no answer in time: late and lost are messages.
std::string words(const roundtrip::Counters& counters) {
  const auto skipped = counters.skipped_cycles;
  return fmt::format("{} late, {} lost of {}", table::grouped(counters.late), table::grouped(counters.lost),
                     table::many(counters.sent, "message", "messages")) +
         (skipped > 0 ? fmt::format("; {} of {} skipped", table::grouped(skipped),
                                    table::many(counters.sent + skipped, "cycle", "cycles"))
                      : "");
}

// Ignores write errors: a full disk under a log must not stop a measurement.
template <typename... Arguments>
void say(fmt::format_string<Arguments...> text, Arguments&&... arguments) {
  std::fputs(for_terminal(fmt::format(text, std::forward<Arguments>(arguments)...), STDERR_FILENO).c_str(),
             stderr);
  std::fflush(stderr);
}

// A terminal can be stopped (Ctrl-S), and a pipe be full. A thread that waits for it must not hold the line.
bool can_write() {
  pollfd out{STDERR_FILENO, POLLOUT, 0};
  return poll(&out, 1, 0) == 1 && (out.revents & POLLOUT) != 0;
}

void erase_line() {
  if (std::exchange(line_is_open, false)) say("\r\033[K");
}

constexpr std::string_view quote =
    "  | ";  // before text from elsewhere: a command to paste stands without it

// On a terminal broken between words. A command at the end stays whole on a line of its own, to be copied.
std::string fitted(const std::string& line) {
  const auto width = columns();
  if (isatty(STDERR_FILENO) == 0 || table::width_of(line) <= width) return line + "\n";
  if (line.starts_with(quote)) return table::wrapped(line.substr(quote.size()), width, std::string(quote));
  std::size_t advice = 0;  // 0: none, and ": ontime" begins a sentence. Text from elsewhere comes before it.
  for (const auto* word : {"Fix", "See: ", "Next: "}) advice = std::max(advice, line.rfind(word) + 1);
  for (auto end = advice == 0 ? line.npos : line.find(": ", advice); end != line.npos;
       end = line.find(": ", end + 1)) {
    const auto command = line.substr(end + 2, line.find(' ', end + 2) - end - 2);
    if (command == "sudo" || command == "ontime" || command.ends_with("/ontime"))
      return wrapped_lines(line.substr(0, end + 1), width) + "  " + line.substr(end + 2) + "\n";
  }
  return wrapped_lines(line, width);
}

// Text from elsewhere (a type name from the network, another machine's words) must not control the terminal.
std::string lines_of(const std::string& text, std::string_view before_further) {
  std::istringstream lines("ontime: " + text);
  std::string result;
  for (std::string line; std::getline(lines, line);)
    result += fitted(std::string(result.empty() ? "" : before_further) + table::printable(line));
  return result;
}

}  // namespace

Terminal::Terminal() : interactive_(can_rewrite_a_line()) {
  if (interactive_)
    ticking_ = thread_without_signals([this](const std::stop_token& stop) { line_at_second(stop); });
}

Terminal::~Terminal() { clear_progress_line(); }

void Terminal::line_at_second(const std::stop_token& stop) {
  std::unique_lock lock(line_mutex);
  std::condition_variable_any none;
  while (!none.wait_for(lock, stop, std::chrono::seconds(1), [&] { return stop.stop_requested(); }))
    if (line_is_open && !doing_.empty() && can_write()) rewrite_line(doing());
}

// Cut to the terminal's width: a second line could not be cleared.
void Terminal::rewrite_line(const std::string& text) {
  erase_line();
  auto line = for_terminal(text, STDERR_FILENO);
  // Between words: 10 would be left of 1022.
  if (const auto part = table::shortened(line, columns() - 3); part != line)
    line = part.substr(0, part.rfind(' ') + 1) + "…";
  say("{}", line);
  line_is_open = true;
}

void Terminal::note(const std::string& text) { print_error(text); }

void Terminal::line(const std::string& text) {
  clear_progress_line();
  say("{}", fitted(table::printable(text)));
}

void Terminal::waits(const std::string& text) {
  if (!interactive_) return;
  const std::lock_guard lock(line_mutex);
  doing_.clear();
  rewrite_line(table::printable(text));
}

void Terminal::does(const std::string& what) {
  if (!interactive_) return;
  const std::lock_guard lock(line_mutex);
  doing_ = table::printable(what);
  measures_ = false;
  doing_since_ = Clock::now();
  rewrite_line(doing());
}

std::string Terminal::doing() const {
  const auto seconds = std::chrono::floor<std::chrono::seconds>(Clock::now() - doing_since_).count();
  const bool says_time = seconds >= 2;  // progress of messages comes each second
  return head() + (name_.empty() ? "" : "  ") + doing_ + (measures_ && !says_time ? "" : " …") +
         (says_time ? fmt::format(" {} s", seconds) : "");
}

void Terminal::expect(const campaign::Plan& plan, const std::string& kind) {
  runs_ = plan.runs;
  to_measure_ = plan.runs - plan.known;
  planned_after_ = plan.time;
  kind_of_time_ = kind;
}

void Terminal::next(const campaign::Run& run, bool is_planned) {
  ++number_;
  if (is_planned && to_measure_ > 0) --to_measure_;
  planned_ = is_planned ? campaign::time_of(run) : Seconds(0);
  planned_after_ -= planned_;
  begun_ = Clock::now();
  const auto repetition = run.repetition > 1 ? fmt::format(" #{}", run.repetition) : "";
  const auto variant = run.variant.empty() ? "" : " " + run.variant;
  const bool has_one_transport =
      std::ranges::all_of(run.own, [&](const auto& own) { return own.task.transport == run.task.transport; });
  name_ = table::printable(fmt::format("{}{}{}{}", table::shortened(run.id, gate::longest_id), variant,
                                       has_one_transport ? " " + run.task.transport : "", repetition));
}

// Of this run and all after it.
Terminal::Seconds Terminal::left() const {
  const auto beyond = measured_ == 0 ? Seconds(0) : beyond_plan_ / measured_;
  const auto after = planned_after_ + beyond * static_cast<double>(to_measure_);
  if (planned_ == Seconds(0)) return after;
  return std::max(Seconds(0), Seconds(planned_ + beyond - (Clock::now() - begun_))) + after;
}

// Until the first run has ended, it is unknown what runs take beyond the plan.
std::string Terminal::head() const {
  if (runs_ < 2 || name_.empty()) return name_;
  if (planned_ == Seconds(0) && to_measure_ == 0) return fmt::format("[{}/{}] {}", number_, runs_, name_);
  return fmt::format("[{}/{}, {}{}{} left] {}", number_, runs_, measured_ == 0 ? "≥ " : "", about(left()),
                     kind_of_time_, name_);
}

void Terminal::begins(const campaign::Run& run) {
  {
    const std::lock_guard lock(line_mutex);
    next(run);
    duration_ = run.task.client.duration;
    // A log that no program reads must not hold a run before it is measured.
    if (!interactive_ && can_write())
      say("{}  starting: {} of messages\n", head(), report::duration(duration_));
  }
  does("starting");
}

void Terminal::passes_over(const campaign::Run& run) {
  const std::lock_guard lock(line_mutex);
  next(run, run.step.of > 0);  // see campaign::Plan::known
  planned_ = {};
  erase_line();
  say("{}  skipped (already in results)\n", head());
  name_.clear();
}

void Terminal::leaves_out(const campaign::Run& run) {
  const std::lock_guard lock(line_mutex);
  next(run);
  name_.clear();
}

void Terminal::progress(const roundtrip::Counters& counters, std::chrono::nanoseconds elapsed) {
  if (!interactive_) return;
  const std::lock_guard lock(line_mutex);
  doing_ = fmt::format("{:.0f}/{:g} s  {}", seconds(elapsed), seconds(duration_), words(counters));
  measures_ = true;
  doing_since_ = Clock::now();
  rewrite_line(doing());
}

void Terminal::ends(const roundtrip::Counters& counters) {
  const std::lock_guard lock(line_mutex);
  const auto now = Clock::now();
  beyond_plan_ += std::max(Seconds(0), Seconds(now - begun_ - planned_));
  ++measured_;
  erase_line();
  say("{}", fitted(fmt::format("{}  {}", head(), words(counters))));
  ended_ = now;
}

void Terminal::recorded(std::int64_t /*run*/) {
  const std::lock_guard lock(line_mutex);
  if (ended_) beyond_plan_ += Clock::now() - *std::exchange(ended_, std::nullopt);
  name_.clear();
}

std::jthread thread_without_signals(std::function<void(const std::stop_token&)> work) {
  sigset_t all, before;
  sigfillset(&all);
  pthread_sigmask(SIG_SETMASK, &all, &before);
  std::jthread thread(std::move(work));
  pthread_sigmask(SIG_SETMASK, &before, nullptr);
  return thread;
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
    if (const char* const first = first_notice.exchange(nullptr); first != nullptr && can_write()) {
      [[maybe_unused]] const auto written = ::write(STDERR_FILENO, first, std::strlen(first));
    }
    errno = error;
  });
  return interrupts;
}

bool was_stopped() { return last_signal == SIGTERM || (last_signal == 0 && interrupts > 0); }

nlohmann::json command_line() { return process::command_line(); }

void clear_progress_line() {
  const std::lock_guard lock(line_mutex);
  erase_line();
}

void print(const std::string& text) {
  clear_progress_line();
  std::fputs(for_output(text).c_str(), stdout);
  // A closed terminal is an interruption, which is already counted.
  if ((std::fflush(stdout) == 0 && std::ferror(stdout) == 0) || interrupts > 0) return;
  if (errno == EPIPE) throw ReaderGone();
  throw campaign::Error(
      3, errno == EBADF ? closed_output
                        : "standard output cannot be written: " + std::generic_category().message(errno));
}

void print_error(const std::string& text) {
  clear_progress_line();
  say("{}", lines_of(text, quote));
}

void print_own_lines(const std::string& text) {
  clear_progress_line();
  say("{}", lines_of(text, "  "));
}

}  // namespace ontime::app

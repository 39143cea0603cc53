// SPDX-License-Identifier: Apache-2.0
// What a person sees while it runs, on standard error; results go to standard output.
#pragma once

#include <chrono>
#include <functional>
#include <optional>
#include <string>
#include <thread>

#include "campaign/campaign.hpp"
#include "report/words.hpp"

namespace ontime::app {

// A line of progress, which is rewritten, between lines that stay. Without a terminal only these.
class Terminal : public campaign::Observer {
 public:
  Terminal();
  ~Terminal() override;
  // The runs, and the kind of their time, simulated_time or "", to show progress.
  void expect(const campaign::Plan&, const std::string& kind);
  void note(const std::string& text) override;
  void line(const std::string& text);           // a line of another ontime, which has its own prefix
  void waits(const std::string& text);          // the next output replaces it
  void does(const std::string& what) override;  // the line also counts its seconds
  void begins(const campaign::Run&) override;
  void passes_over(const campaign::Run&) override;
  void leaves_out(const campaign::Run&) override;
  void progress(const roundtrip::Counters&, std::chrono::nanoseconds elapsed) override;
  void ends(const roundtrip::Counters&) override;
  void recorded(std::int64_t run) override;
  bool shows_progress() const { return interactive_; }

 private:
  using Clock = std::chrono::steady_clock;
  using Seconds = std::chrono::duration<double>;
  void next(const campaign::Run&, bool is_planned = true);
  Seconds left() const;
  std::string head() const;  // "[2/3, 45 s left] loaded udp"
  std::string doing() const;
  void rewrite_line(const std::string& text);
  void line_at_second(const std::stop_token&);

  const bool interactive_;
  // Of all that follows: another thread rewrites the line.
  std::string name_;   // of the run; "": none is carried out
  std::string doing_;  // or how far the messages are; "": the line shows something else
  bool measures_ = false;
  Clock::time_point begun_, doing_since_;
  std::optional<Clock::time_point> ended_;              // its messages; traces are read then
  std::size_t runs_ = 1, number_ = 0, to_measure_ = 0;  // all; this one; after it, at most
  Seconds planned_{0}, planned_after_{0};               // for this run, and for all after it
  // What the runs so far took beyond the plan: to start load, to read traces.
  Seconds beyond_plan_{0};
  std::size_t measured_ = 0;
  std::string kind_of_time_;
  std::chrono::nanoseconds duration_{0};
  std::jthread ticking_;  // last: it uses the rest
};

// Before anything else is printed to a terminal; print() and print_error() do it.
void clear_progress_line();

// A thread that receives no signals: the handlers interrupt what waits on the main thread.
std::jthread thread_without_signals(std::function<void(const std::stop_token&)>);

// Counts SIGINT, SIGTERM and SIGHUP from now on. The first one prints `notice`, because the end may take
// seconds; "": nothing.
campaign::Interrupts& catch_interrupts(const std::string& notice = "");
// Whether the service manager stopped it: the last signal was SIGTERM, or until now only a worker got one.
bool was_stopped();

// How this program was called, for the record.
nlohmann::json command_line();

// To standard output, all of it, or throws Error or ReaderGone.
void print(const std::string& text);
template <class Json>
void print_json(const Json& value) {
  print(report::json_text(value));
}
// To standard error, as "ontime: text"; never throws. Further lines are another program's: they are quoted.
void print_error(const std::string& text);
void print_own_lines(const std::string& text);  // the same of lines that are all ontime's

}  // namespace ontime::app

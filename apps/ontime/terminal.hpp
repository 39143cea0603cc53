// SPDX-License-Identifier: Apache-2.0
// What a person sees while it runs, on standard error; results go to standard output.
#pragma once

#include "campaign/campaign.hpp"

namespace ontime::app {

class Terminal : public campaign::Observer {
 public:
  Terminal();
  // The number of runs, their total time and its kind, simulated_time or "", to show progress.
  void expect(std::size_t runs, std::chrono::duration<double> time, const std::string& kind);
  void note(const std::string& text) override;
  void line(const std::string& text);   // a line of another ontime, which has its own prefix
  void waits(const std::string& text);  // the next output replaces it
  void begins(const campaign::Run&) override;
  void passes_over(const campaign::Run&) override;
  void leaves_out(const campaign::Run&) override;
  void progress(const roundtrip::Counters&, std::chrono::nanoseconds elapsed) override;
  void ends(const roundtrip::Counters&) override;
  void clear_line();  // before anything else is printed there

 private:
  std::string next(const campaign::Run&);  // the run's name and progress
  void rewrite_line(const std::string& text);
  const bool interactive_;
  bool line_open_ = false;
  std::string head_;
  std::size_t runs_ = 1, number_ = 0;
  std::chrono::duration<double> left_{0};  // of this run and all after it
  std::string kind_of_time_;
  std::chrono::nanoseconds duration_{0};
};

// Counts SIGINT, SIGTERM and SIGHUP from now on. The first one prints `notice`, because the end may take
// seconds; "": nothing.
campaign::Interrupts& catch_interrupts(const std::string& notice = "");
// Whether the service manager stopped it: the last signal was SIGTERM, or until now only a worker got one.
bool was_stopped();

// How this program was called, for the record.
nlohmann::json command_line();

// To standard output, all of it, or throws Error.
void print(const std::string& text);
// As ASCII: control characters become JSON escapes, with the same value.
template <class Json>
void print_json(const Json& value) {
  print(value.dump(2, ' ', true, Json::error_handler_t::replace) + "\n");
}
// To standard error, as "ontime: text"; never throws.
void print_error(const std::string& text);

}  // namespace ontime::app

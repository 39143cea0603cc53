// SPDX-License-Identifier: Apache-2.0
// What a person sees while it runs, on standard error; results go to standard output.
#pragma once

#include "campaign/campaign.hpp"
#include "report/report.hpp"

namespace ontime::app {

class Terminal final : public campaign::Observer {
 public:
  Terminal();
  void note(const std::string& text) override;
  void begins(const campaign::Run&, std::size_t number, std::size_t of) override;
  void progress(const roundtrip::Counters&, std::chrono::nanoseconds elapsed) override;
  void ends(const roundtrip::Counters&) override;

 private:
  void clear_line();
  const bool interactive_;
  bool line_open_ = false;
  std::string head_;
  std::chrono::nanoseconds duration_{0};
};

// Counts SIGINT, SIGTERM and SIGHUP from now on.
campaign::Interrupts& catch_interrupts();
bool was_stopped();  // the last of them was SIGTERM: whoever started this as a service stopped it

// How this program was called, for the record.
nlohmann::json command_line();

// To standard output, all of it, or throws Error.
void print(const std::string& text);
// To standard error, as "ontime: text"; never throws.
void print_error(const std::string& text);

// Prints the report on the runs that came after the first `known`.
void print_report(const record::Reader&, std::size_t known, report::Format);

}  // namespace ontime::app

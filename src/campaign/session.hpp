// SPDX-License-Identifier: Apache-2.0
// What is measured at one time: a run, or one for each of several components, on the same machines.
#pragma once

#include "campaign/campaign.hpp"
#include "campaign/machines.hpp"
#include "campaign/pair.hpp"
#include "campaign/windows.hpp"
#include "security/security.hpp"

namespace ontime::campaign {

class Session {
 public:
  // The results of runs[i] go into the writer as run numbers[i].
  Session(const Together&, const std::vector<std::int64_t>& numbers, orders::Coordinator&, Machines&,
          record::Writer&, Observer&, Interrupts&);
  ~Session();
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  // Measures; returns the outcomes for the record, with "error" if the results are not valid. Throws Error or
  // Interrupted; what was measured until then is in the writer, and salvage() has the counters.
  std::vector<record::Outcome> measure(std::chrono::nanoseconds wait);
  // After an error: the counters of each client that still answers.
  std::vector<record::Outcome> salvage() noexcept;
  roundtrip::Counters counters() const;  // of all runs together
  // Whether counted messages may have been sent, even if no sample has arrived.
  bool has_begun() const { return measuring_; }

 private:
  using Clock = std::chrono::steady_clock;
  void next(const std::string& step);
  void finish(std::chrono::nanoseconds patience);
  bool component_is_gone(const std::string& why);
  void restart_components();
  void note_other(const std::string& host, const std::string& command);
  std::vector<record::Outcome> outcomes();
  void await_windows();
  void await_background();
  std::chrono::nanoseconds longest_timeout() const;

  const Together& runs_;
  const Run& run_;  // the first: of what they have in common
  orders::Coordinator& coordinator_;
  Machines& machines_;
  record::Writer& writer_;
  Observer& observer_;
  Interrupts& interrupts_;
  std::vector<std::unique_ptr<Pair>> pairs_;
  Clock::time_point started_;
  std::chrono::nanoseconds lasted_{};  // to its end, or until it was interrupted
  bool measuring_ = false, stopped_ = false;
  std::optional<security::Authority> authority_;
  std::vector<Windows> windows_;  // of each run, where they are explained
};

}  // namespace ontime::campaign

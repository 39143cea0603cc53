// SPDX-License-Identifier: Apache-2.0
// One run, on agents that live just for it.
#pragma once

#include "campaign/campaign.hpp"
#include "campaign/machines.hpp"
#include "campaign/windows.hpp"

namespace ontime::campaign {

class Session {
 public:
  // With hosts that are alone somebody else serves.
  // What comes of it goes into the writer, as run `number`.
  Session(const Run&, std::int64_t number, orders::Coordinator&, Machines&, record::Writer&, Observer&,
          Interrupts&);
  ~Session();
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  // Measures; returns the outcome for the record, in which "error" says what went wrong at last. Throws
  // Error or Interrupted; what was measured until then is in the writer, and salvage() has the counters.
  nlohmann::json measure(std::chrono::nanoseconds wait);
  // After an error: what the client counted, if it can still be asked.
  nlohmann::json salvage() noexcept;

 private:
  using Hand = orders::Coordinator::Hand;
  struct End {
    std::string host;
    std::unique_ptr<Hand> agent;
    nlohmann::json opened, ended;
  };
  End open(const std::string& host, const agent::Task&);
  void make_ready(End&, std::chrono::milliseconds patience);
  void begin(End&);
  std::vector<End*> ends();
  void listen_to(Hand& client);
  void finish(std::chrono::nanoseconds patience);
  bool may_restart_component() const;
  void restart_component(const std::string& why);
  nlohmann::json outcome();
  void await_windows();
  void note_peers(const nlohmann::json& event);
  void note_cut(std::int64_t at_ns);

  const Run& run_;
  const std::int64_t number_;
  orders::Coordinator& coordinator_;
  Machines& machines_;
  record::Writer& writer_;
  Observer& observer_;
  Interrupts& interrupts_;
  std::optional<End> controller_, component_;
  std::chrono::nanoseconds wait_{0};
  std::chrono::steady_clock::time_point started_, sampled_;  // sampled_: when samples came last
  int pongs_ = 1;                                            // that answer
  bool measuring_ = false, stopped_ = false;
  std::optional<nlohmann::json> finished_;
  std::optional<Windows> windows_;
  nlohmann::json traced_;
};

// The server's part of a run.
agent::Task server_task(const Run&, const Host&);

}  // namespace ontime::campaign

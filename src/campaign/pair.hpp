// SPDX-License-Identifier: Apache-2.0
// The two ends of one run, with agents for this run only: the client at the controller and the server at a
// component; and two more if background topics run in another process.
#pragma once

#include "agent/agent.hpp"
#include "campaign/campaign.hpp"
#include "campaign/link.hpp"
#include "campaign/machines.hpp"
#include "record/record.hpp"

namespace ontime::security {
class Authority;
}

namespace ontime::campaign {

class Pair {
 public:
  // Callbacks while the client measures, from the loop.
  struct Told {
    std::function<void(std::span<const roundtrip::Sample>)> samples;
    std::function<void()> progress;
  };
  // With Hosts::Kind::alone another program is the server. Samples and notes go into the writer, as run
  // `number`.
  Pair(const Run&, std::int64_t number, const Machines&, record::Writer&, Observer&, Told,
       const security::Authority*);

  // Each once, in this order. All throw Error.
  void open();
  void make_ready(std::chrono::nanoseconds wait);  // matched, warmed up, silent
  void begin();                                    // the accounts
  void go();
  void stop();                                                // ends it early, if it is not over
  bool over() const;                                          // it has finished, or cannot finish
  bool overdue(std::chrono::steady_clock::time_point) const;  // past that time, without new samples
  void end();
  // For the record: what is known of a run that failed; and after end(), what each end and its machine did.
  record::Outcome outcome() const;
  record::Outcome outcome(const Machines::Account&) const;

  const Run& run() const { return run_; }
  std::optional<Claim> claim() const;  // once it is open
  std::int64_t number() const { return number_; }
  const roundtrip::Counters& counters() const { return counters_; }
  // While it measures: whether the server was lost and must be restarted; adds a note then.
  bool component_is_gone(const std::string& why);
  bool lacks_component() const { return gone_.has_value(); }  // from then on, until restart_component()
  void restart_component();                                   // throws as the others do
  // After an error: stops the client, if it still runs, so that it reports its counters.
  void abandon();
  void note_cut(std::int64_t at_ns);

 private:
  using Hand = orders::Coordinator::Hand;
  using Clock = std::chrono::steady_clock;
  struct End {
    std::string host, role;
    std::unique_ptr<Hand> agent;
    record::Host opened, ended;
    bool again = false;                    // restarted while the client measured
    std::vector<std::string> addresses{};  // of its place
    int mtu = 0;                           // of its interface; 0: unknown
  };
  End open(const std::string& host, agent::Task);
  nlohmann::json ask_host(const End&, nlohmann::json task) const;
  nlohmann::json ask(const End&, const char* order, const char* answer, nlohmann::json body,
                     std::chrono::milliseconds longest = patience) const;
  std::vector<End*> ends();
  void listen_to(Hand& client);
  void note_peers(const nlohmann::json& event);
  void note_downs(const End&);
  std::string different_mtus() const;
  void note_now(const char* kind, const std::string& text);

  const Run& run_;
  const std::int64_t number_;
  const Machines& machines_;
  record::Writer& writer_;
  Observer& observer_;
  const Told told_;
  const security::Authority* const authority_;  // null: the run has no DDS Security
  std::optional<End> controller_, component_;
  std::vector<End> background_;  // agents of background topics: component, controller
  std::chrono::nanoseconds wait_{0};
  Clock::time_point sampled_;  // when samples came last
  int pongs_ = 1;              // that answer
  bool measuring_ = false;
  std::optional<Clock::time_point> gone_;  // when its component was found to be gone
  roundtrip::Counters counters_;
  std::uint64_t late_by_response_ = 0;
  bool finished_ = false;
};

// The server's part of a run.
agent::Task server_task(const Run&, const Host&);
// What the record says of the run's cut, which began at this time.
std::vector<record::Note> notes_of_cut(const Run&, std::int64_t at_ns);

}  // namespace ontime::campaign

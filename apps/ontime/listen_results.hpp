// SPDX-License-Identifier: Apache-2.0
// Writes the messages of a robot's own topics as runs of a results file: one for each quantity (age, period)
// of a flow. Ordinary thread. It keeps all messages, or, for weeks, a histogram and the worst messages with
// their surroundings; record::Writer::keep_worst() bounds the file. notes_of() reads why they were late.
#pragma once

#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "listen/listen.hpp"
#include "machine/machine.hpp"
#include "record/record.hpp"

namespace ontime::app {

class ListenResults {
 public:
  // `limits` become the deadlines of the runs. `asked`: further members of their records; an "id" there (of
  // the run measured meanwhile) is the prefix of their ids. A recording tells nothing of this machine.
  ListenResults(record::Writer&, const listen::Limits& limits, nlohmann::json asked, bool is_recording,
                bool keeps_worst = false);

  void keep(const listen::Row&);
  bool is_full() const { return waiting_ >= most_waiting; }  // call write()
  // Call it about every second, with the wanted flows: begins the runs of flows that are known by now, and
  // writes their messages. Messages of other flows are dropped after some seconds.
  void write(const std::vector<listen::Flow>& wanted);
  // Notes why a message was late. If only the worst are kept: keeps it with its surroundings.
  void note(const listen::Miss&);
  // Writes the rest, and the outcome of each run. `pauses`: text on the pauses of listening; "": none.
  void end(const listen::Findings& wanted, bool interrupted, const std::string& pauses = "");
  void forget();  // removes the runs from the file
  std::size_t runs() const { return runs_; }
  // Runs of a recording that the file had before: they were not added.
  std::size_t known() const { return known_; }
  // Why nothing is recorded, such as a full disk; empty: it is. What comes meanwhile is counted.
  std::string failure() const { return failed_ ? failed_->why : ""; }
  // A line for people, once: that recording stopped, or goes on; else empty.
  std::string take_news() { return std::exchange(news_, {}); }
  std::chrono::nanoseconds try_again_after = std::chrono::seconds(10);
  // The Writer has no other runs: if its file is renamed or removed, go on in a new one at its path.
  bool owns_file = false;
  std::chrono::nanoseconds look_at_file_every = std::chrono::seconds(10);

 private:
  static constexpr std::size_t most_waiting = 100'000;
  using Clock = std::chrono::steady_clock;
  struct Failed {
    std::string why, since;
    Clock::time_point again_at;
  };
  // A message to be kept.
  struct Bad {
    std::int64_t value_ns = 0, at_ns = 0;
    std::vector<roundtrip::Sample> around{};  // itself among them
    std::optional<record::Note> cause{};
    record::Trace trace{};
  };
  struct Counted {
    std::optional<std::uint64_t> lost;
    std::uint64_t duplicated = 0, reordered = 0, not_judged = 0;
  };
  struct Kept {
    std::vector<roundtrip::Sample> samples;
    // If only the worst are kept: the latest messages, which may surround one.
    std::deque<roundtrip::Sample> latest;
    std::vector<Bad> worst;                    // to be written
    std::optional<Clock::time_point> told_at;  // the outcome until then
    std::chrono::seconds tell_after{1};        // doubles
    bool is_told = false;                      // nothing came since then
    std::string name;                          // in names_
    listen::Distribution values;               // of rows
    Counted counted, counted_before;           // by the sensor: in all, and before this file
    Clock::time_point since = Clock::now();
    std::int64_t run = 0;                   // 0: not begun
    std::vector<record::Note> notes;        // until it begins
    std::optional<roundtrip::Sample> last;  // by index
    std::int64_t late = 0, lost = 0;        // rows
    std::int64_t not_recorded = 0;          // of these
    record::Causes causes;                  // of examined late messages
  };
  void add(Kept&, const roundtrip::Sample&, bool was_lost = false);
  void note_not_judged(const Kept&);
  void note_open_age(const listen::Flow&);
  void add_silence(const listen::Flow&);
  void keep(Kept&, const roundtrip::Sample&, const listen::Miss*, std::optional<record::Note> cause);
  void write_worst(Kept&);
  nlohmann::json outcome_of(listen::Row::Quantity, const Kept&) const;
  static Counted counted_of(const Kept&);
  nlohmann::json about_machine() const;
  const nlohmann::json& recent_about();
  void end_runs(const listen::Findings& wanted, bool interrupted, const std::string& pauses);
  void begin_anew(const std::vector<listen::Flow>& wanted);
  void tell(const std::string& news);
  void write(const std::vector<listen::Flow>& wanted, bool is_end);
  void until_it_fails(const std::function<void()>&);
  void fail(const std::string& why);
  void go_on();
  void count_not_recorded();
  void begin(Kept&, const listen::Flow&, listen::Row::Quantity, bool has_twin);
  void forget_known();

  record::Writer& writer_;
  const listen::Limits limits_;
  const nlohmann::json asked_;
  const bool is_recording_, keeps_worst_;
  std::size_t waiting_ = 0;  // rows
  machine::Activity before_ = machine::activity();
  const std::int64_t began_s_ = std::chrono::system_clock::to_time_t(std::chrono::system_clock::now());
  nlohmann::json about_;  // this machine
  std::optional<Clock::time_point> about_at_;
  bool needs_file_ = false;
  Clock::time_point look_at_file_ = Clock::now();
  std::map<std::pair<std::uint64_t, listen::Row::Quantity>, Kept> kept_;
  std::set<std::string> names_;  // of runs
  std::size_t runs_ = 0, known_ = 0;
  std::uint64_t left_out_ = 0;  // rows with invalid times
  std::optional<Failed> failed_;
  std::optional<Clock::time_point> went_on_at_;
  std::chrono::nanoseconds until_tried_again_{};
  int gaps_ = 0;
  std::string news_;
};

// Renames the log of a results file that is gone: a service whose file was renamed just before a power cut
// would refuse to start for ever. A line for people; empty: it stays, for example because another process
// still writes it.
std::string set_lone_log_aside(const std::string& results);

// The notes of a run, for `ontime explain`: those of late messages name their messages. Of the worst
// messages, this version of ontime finds the causes again in their traces, worst message first. Where a trace
// is incomplete, the recorded cause stays.
std::vector<record::Note> notes_of(const record::Reader&, const record::Run&);

}  // namespace ontime::app

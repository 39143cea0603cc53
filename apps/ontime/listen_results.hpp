// SPDX-License-Identifier: Apache-2.0
// Writes the messages of a robot's own topics as runs of a results file: one for each quantity (age, period)
// of a flow. Ordinary thread. It keeps all messages, or, for weeks, a histogram and the worst messages with
// their surroundings; record::Writer::keep_worst() bounds the file. notes_of() reads why they were late.
#pragma once

#include <chrono>
#include <cstdint>
#include <deque>
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
  // Why recording stopped, such as a full disk; empty: it did not.
  const std::string& failure() const { return failure_; }

 private:
  static constexpr std::size_t most_waiting = 100'000;
  using Clock = std::chrono::steady_clock;
  // A message to be kept.
  struct Bad {
    std::int64_t value_ns = 0, at_ns = 0;
    std::vector<roundtrip::Sample> around{};  // itself among them
    std::optional<record::Note> cause{};
    record::Trace trace{};
  };
  struct Kept {
    std::vector<roundtrip::Sample> samples;
    // If only the worst are kept: the latest messages, which may surround one.
    std::deque<roundtrip::Sample> latest;
    std::vector<Bad> worst;                    // to be written
    std::optional<Clock::time_point> told_at;  // the outcome until then
    bool is_told = false;                      // nothing came since then
    std::string name;                          // in names_
    listen::Distribution values;               // of rows
    struct {
      std::optional<std::uint64_t> lost;
      std::uint64_t duplicated = 0, reordered = 0, not_judged = 0;
    } counted;  // by the sensor
    Clock::time_point since = Clock::now();
    std::int64_t run = 0;                   // 0: not begun
    std::vector<record::Note> notes;        // until it begins
    std::optional<roundtrip::Sample> last;  // by index
    std::int64_t late = 0, lost = 0;        // rows
    record::Causes causes;                  // of examined late messages
  };
  void add(Kept&, const roundtrip::Sample&, bool was_lost = false);
  void note_not_judged(const Kept&);
  void note_open_age(const listen::Flow&);
  void add_silence(const listen::Flow&);
  void keep(Kept&, const roundtrip::Sample&, const listen::Miss*, std::optional<record::Note> cause);
  void write_worst(Kept&);
  nlohmann::json outcome_of(listen::Row::Quantity, const Kept&) const;
  nlohmann::json about_machine() const;
  void write(const std::vector<listen::Flow>& wanted, bool is_end);
  template <class Do>
  void until_it_fails(const Do&);
  void begin(Kept&, const listen::Flow&, listen::Row::Quantity, bool has_twin);
  void forget_known();

  record::Writer& writer_;
  const listen::Limits limits_;
  const nlohmann::json asked_;
  const bool is_recording_, keeps_worst_;
  std::size_t waiting_ = 0;  // rows
  const machine::Activity before_ = machine::activity();
  std::map<std::pair<std::uint64_t, listen::Row::Quantity>, Kept> kept_;
  std::set<std::string> names_;  // of runs
  std::size_t runs_ = 0, known_ = 0;
  std::uint64_t left_out_ = 0;  // rows with invalid times
  std::string failure_;
};

// The notes of a run, for `ontime explain`: those of late messages name their messages. Of the worst
// messages, this version of ontime finds the causes again in their traces, worst message first. Where a trace
// is incomplete, the recorded cause stays.
std::vector<record::Note> notes_of(const record::Reader&, const record::Run&);

}  // namespace ontime::app

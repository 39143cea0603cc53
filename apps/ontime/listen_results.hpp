// SPDX-License-Identifier: Apache-2.0
// The messages of a robot's own topics as runs of a results file: one for each quantity (age, period) of a
// flow. Ordinary thread.
#pragma once

#include <chrono>
#include <cstdint>
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
  // `limits` become the deadlines of the runs. `asked`: what else their records have; an "id" there, of what
  // was measured meanwhile, begins theirs. A recording tells nothing of this machine.
  ListenResults(record::Writer&, const listen::Limits& limits, nlohmann::json asked, bool is_recording);

  void keep(const listen::Row&);
  bool is_full() const { return waiting_ >= most_waiting; }  // write() what was kept
  // Every second or so, with the flows that are wanted: begins the runs of those that are known by now, and
  // hands over what was kept of them. Of others nothing is kept for long.
  void write(const std::vector<listen::Flow>& wanted);
  // Why a message was late.
  void note(const listen::Miss&);
  // The same once more, and the outcome of each run.
  void end(const listen::Findings& wanted, bool interrupted);
  void forget();  // the runs, as if they had never begun
  std::size_t runs() const { return runs_; }
  // Why nothing is kept any more, as a full disk; empty: it is.
  const std::string& failure() const { return failure_; }

 private:
  static constexpr std::size_t most_waiting = 100'000;
  using Clock = std::chrono::steady_clock;
  struct Kept {
    std::vector<roundtrip::Sample> samples;
    Clock::time_point since = Clock::now();
    std::int64_t run = 0;                   // 0: not begun
    std::vector<record::Note> notes;        // until it begins
    std::optional<roundtrip::Sample> last;  // by index
    std::int64_t late = 0, lost = 0;        // rows
  };
  void add(Kept&, const roundtrip::Sample&);
  void add_silence(const listen::Flow&);
  nlohmann::json outcome_of(const listen::Flow*, listen::Row::Quantity, const Kept&) const;
  void write(const std::vector<listen::Flow>& wanted, bool is_end);
  void end_runs(const listen::Findings& wanted, bool interrupted);
  template <class Do>
  void until_it_fails(const Do&);
  std::int64_t begin(const listen::Flow&, listen::Row::Quantity);

  record::Writer& writer_;
  const listen::Limits limits_;
  const nlohmann::json asked_;
  const bool is_recording_;
  std::size_t waiting_ = 0;  // rows
  const machine::Activity before_ = machine::activity();
  std::map<std::pair<std::uint64_t, listen::Row::Quantity>, Kept> kept_;
  std::set<std::string> names_;  // of runs
  std::size_t runs_ = 0;
  std::uint64_t left_out_ = 0;  // rows whose times no clock has
  std::string failure_;
};

}  // namespace ontime::app

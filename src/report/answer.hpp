// SPDX-License-Identifier: Apache-2.0
// The first screen: what the runs showed, and what to do next, as data; terminal, page and JSON show the
// same. Ordinary thread.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "statistics/statistics.hpp"

namespace ontime::report {

// Where the runs come from, for commands that users paste. A scenario can start programs: of runs that
// another process measured, these name only scenarios that `trusts`.
struct Origin {
  std::string file;         // the results file; empty: none was kept
  bool is_root = false;     // commands need no sudo
  std::string only = {};    // these are the runs that `--only` chose; empty: all of the file
  bool is_own = false;      // this process measured them: their command lines are no stranger's
  std::string finish = {};  // the command line that measures what is left; empty: as the runs tell it
  std::function<bool(const std::string& scenario)> trusts = {};  // empty: none
  // Another process writes into the file: it measures the runs from this number on that have not ended.
  std::optional<std::int64_t> running_from = {};
  bool has_no_root = false;  // sudo permits nothing here, as in a container: commands that need it fail
};

struct Answer {
  // The worst one of the repetitions. no_limit: of a robot's own messages, nothing tells which were late or
  // lost.
  enum class State { imported, no_limit, ok, late, not_applied, running, cut_off, failed };
  struct Spread {  // of repetitions; of one run all three are the same
    double low_ns = 0, median_ns = 0, high_ns = 0;
    bool is_least = false;  // beyond an imported histogram: a lower limit
  };
  // A run, or its repetitions together.
  struct Row {
    std::string id, conditions, name;  // "Test1.B", "load, RT", "cyclonedds 32 KiB"
    std::vector<std::int64_t> runs;    // their numbers in the file
    State state = State::imported;
    bool missed_requirement = false, open_requirement = false;  // of a repetition
    std::uint64_t cycles = 0, missed = 0;                       // all; those without an answer in time
    bool knows_missed = false;                                  // else nothing tells which were late or lost
    // The longest that a cycle waited for its answer. `is_open`: no answer ended it.
    std::optional<double> worst_wait_ns;
    bool is_open = false;
    // Of round trips; of imported runs wake-ups. Nothing: a repetition has too few.
    std::optional<Spread> p50, p99;
    std::optional<double> max_ns;
  };
  struct Step {
    std::string why, command;
    std::vector<std::string> fill_in = {};  // words of the command that a stranger's file does not choose
  };
  std::string sentence;    // what the conditions did
  std::string conditions;  // what all runs have in common: "500 B every 10 ms, 20 s a run"
  const char* times = "waits and round trips";  // of the rows
  std::vector<Row> rows;
  std::vector<std::string> cautions;  // the gravest first
  std::vector<Step> next;
};
Answer answer_of(const std::vector<statistics::Summary>&, const Origin&);

inline constexpr std::size_t screen_lines = 24;
// At most `screen_lines` lines of `width` columns. A command may take several lines.
std::string text_of(const Answer&, std::size_t width);
std::string steps_text(const std::vector<Answer::Step>&, std::size_t width);
nlohmann::ordered_json json_of(const Answer&);  // docs/reference/json.md
Answer::State state_of(const statistics::Summary&, std::optional<std::int64_t> running_from = {});
// Of a percentile, or the maximum. Of all repetitions, or of none: those with too few answers for a
// percentile are the worst ones, which skipped or lost most. One that was cut off or failed may have too few
// for another reason.
std::optional<Answer::Spread> spread_of(const std::vector<const statistics::Summary*>&, statistics::Figure);
const char* word_of(Answer::State);  // "ok", "LATE", "NOT APPLIED" …
// " (NOT APPLIED)", of repetitions the gravest: what makes numbers others than those that were requested.
// Else empty.
std::string unfit_mark(const std::vector<const statistics::Summary*>&,
                       std::optional<std::int64_t> running_from = {});

// For answer_of(): the commands that follow, each about one run. Null: no such run.
struct Findings {
  const statistics::Summary *any = nullptr, *late = nullptr, *from = nullptr, *to = nullptr,
                            *denied = nullptr, *unfinished = nullptr;
  bool failed = false;
  const statistics::Summary* longer =
      nullptr;  // nothing was late; if it took so long, that would be bounded closer
  double longer_ns = 0;
  std::string longer_tells;  // "Prove < 1 miss in 10,000"
};
std::vector<Answer::Step> next_steps(const Findings&, const Origin&);

}  // namespace ontime::report

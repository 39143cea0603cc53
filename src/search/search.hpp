// SPDX-License-Identifier: Apache-2.0
// The search for the smallest set of settings by which a goal holds. It knows no machine: it says which set
// is to be measured next, and is told what came of it.
//
//   measure → what made messages late → propose → try beside the present set → keep what is proven
//   → once the goal holds, leave out members until each is needed → measure the set and the start afresh.
//
// Errors. A member stays only if the goal is proven to fail without it, and all such proofs of one search
// together are wrong with probability `alpha` at most. So are the two final statements that the goal holds:
// the start without any setting has alpha / 4, and all confirmations together have the rest. Evidence is
// e-values (evidence.hpp); the k-th statement of a kind has 1 / (k (k + 1)) of its alpha. What only steers
// has more: `improves` and `harms` have alpha each; `holds` before the confirmation has 0.2, and so has an
// improvement that shows in all runs of a trial without being proven.
//
// A set that cannot be set here is not tried again. Where one setting alone is refused, the others are tried
// without it. A run that failed for a reason that may pass is made again: after three the set is refused.
//
// The same answers lead to the same search: with the kept answers it can go on.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "explain/explain.hpp"
#include "search/evidence.hpp"

namespace ontime::search {

using explain::Setting;
using Set = std::map<std::string, std::string>;  // a key of a scenario → its value

// What of the messages may break a limit of the goal, such as 0.001 of them for p99.9. 0: none may; then
// fewer than one burst of them in a run has to be proven, and none may have been seen in the last runs.
struct Limit {
  std::string text;
  double share = 0;
};

struct Knob {
  std::string key;
  std::vector<std::string> values;  // in the order in which they are tried
};

struct Problem {
  std::vector<Limit> goal;
  std::vector<Knob> knobs;  // what may be set
  double alpha = 0.05;
  std::uint64_t seed = 1;  // of the order of runs
};

// Messages of a run that break one limit. `effect`: so many of them tell as much as an independent one.
struct Tally {
  double events = 0, messages = 0, effect = 1;
};

// What made messages late, and what may remove it: alternatives, the best first.
struct Finding {
  std::string cause;
  double messages = 0;  // of those that were looked at: some of each run, the worst
  std::vector<Setting> remedies;
};
std::string text_of(const Finding&);  // "31 of the messages looked at: napi/eth1-1 waited for a CPU"

// What came of a run.
struct Answer {
  std::vector<Tally> tallies;  // one for each limit of the goal
  std::vector<Finding> findings;
  std::string refused;            // why there is no measurement, for people; "": it was measured
  bool may_pass = false;          // another run of the set may be measured
  std::string refused_setting{};  // the key that cannot be set here; "": it is not known to be a single one
  bool is_recalled = false;       // from the runs of an earlier process
};

// What is to be measured next. Runs of one trial alternate between its set and what that is compared with.
struct Order {
  int trial = 0, number = 0;  // from 1; `number` counts all runs
  Set set;
};
// Nothing: there is no time for it.
using Measure = std::function<std::optional<Answer>(const Order&)>;

// Of messages that broke a limit, and between what the true share lies.
struct Share {
  Range range{};
  double events = 0, messages = 0;
};

enum class Decision {
  holds,      // the goal is proven to hold
  fails,      // it is proven to fail
  improves,   // fewer messages break a limit than without, proven
  harms,      // more do, proven
  no_effect,  // neither was proven
  refused
};
const char* word_of(Decision);

struct Trial {
  enum class Purpose { measure, add, remove, confirm } purpose = Purpose::measure;
  Set set{}, reference{};  // what was tried, and beside what; `measure` has it alone
  int runs = 0;            // of both
  Decision decision = Decision::no_effect;
  std::string why{};                                // the cause that it is to remove, or why it was refused
  std::vector<Share> shares{}, reference_shares{};  // of each limit; empty: no run was measured
};
const char* word_of(Trial::Purpose);

// What a member does: the shares without it minus those with it.
struct Contribution {
  Setting member;
  std::vector<Range> less;  // of each limit
  bool is_needed = false;   // proven: without it the goal fails
};

// What is proven of a limit: a smaller share of messages than `below` breaks it; one-sided, by its part of
// alpha. The goal permits `permitted`.
struct Proof {
  double below = 1, permitted = 0;
};

// not_proven: what was measured is too little to tell whether the goal holds. nothing_left: it fails.
enum class End { goal_holds, not_proven, nothing_left, no_time, cannot_measure };
const char* word_of(End);

struct Outcome {
  End end = End::nothing_left;
  Set set;                    // the smallest by which the goal holds, or the best that was found
  std::vector<Proof> proofs;  // of goal_holds: one for each limit
  std::vector<Contribution> contributions;
  std::vector<Trial> trials;
  std::vector<Finding> remaining;  // what still makes messages late, most messages first
  int runs = 0;
  std::string why;  // of cannot_measure
};

Outcome find(const Problem&, const Measure&);

}  // namespace ontime::search

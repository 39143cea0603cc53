// SPDX-License-Identifier: Apache-2.0
// The search for the smallest set of settings by which a goal holds. It knows no machine: it requests runs of
// a set and gets their results.
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
// A refused set is not tried again. If one setting is refused, the others are tried without it. A run whose
// failure may pass is retried: after three failures the set is refused.
//
// The same answers lead to the same search, so a search resumes from stored answers.
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

// The share of messages that may break a limit of the goal, such as 0.001 for p99.9. With 0 the proof is
// fewer than one burst per run, and the last runs must have no such message.
struct Limit {
  std::string text;
  double share = 0;
};

struct Knob {
  std::string key;
  std::vector<std::string> values;  // in the order in which they are tried
  std::string part_of{};  // the knob that it switches on, too: no set has it without that one; "": none
};

struct Problem {
  std::vector<Limit> goal;
  std::vector<Knob> knobs;  // what may be set
  double alpha = 0.05;
  std::uint64_t seed = 1;  // of the order of runs
};

// Messages of a run that break one limit. `effect`: the design effect.
struct Tally {
  double events = 0, messages = 0, effect = 1;
};

// A cause of late messages and its alternative remedies, the best first.
struct Finding {
  std::string cause;
  double messages = 0;  // of the analyzed messages: the worst of each run
  std::vector<Setting> remedies;
};
std::string text_of(const Finding&);  // "31 of the analyzed messages: napi/eth1-1 waited for a CPU"

// The result of a run.
struct Answer {
  std::vector<Tally> tallies;  // one for each limit of the goal
  std::vector<Finding> findings;
  std::string refused;            // why there is no measurement, for people; "": it was measured
  bool may_pass = false;          // another run of the set may be measured
  std::string refused_setting{};  // the key that cannot be set here; "": it is not known to be a single one
  bool is_recalled = false;       // from the runs of an earlier process
};

// The next run. Runs of one trial alternate between its set and the reference.
struct Order {
  int trial = 0, number = 0;  // from 1; `number` counts all runs
  Set set;
};
// Nothing: no time is left.
using Measure = std::function<std::optional<Answer>(const Order&)>;

// Messages that broke a limit, and the confidence interval of their share.
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
  Set set{}, reference{};  // the tried set and its reference; `measure` has no reference
  int runs = 0;            // of both sets
  Decision decision = Decision::no_effect;
  std::string why{};                                // the cause to remove, or why the set was refused
  std::vector<Share> shares{}, reference_shares{};  // of each limit; empty: no run was measured
};
const char* word_of(Trial::Purpose);

// The effect of a member: the shares without it minus those with it.
struct Contribution {
  Setting member;
  std::vector<Range> less;  // of each limit
  bool is_needed = false;   // proven: without it the goal fails
};

// The proof of a limit: a share of messages below `below` breaks it (one-sided). The goal permits
// `permitted`. A burst of up to `burst` such messages counts as one: where bursts are longer than any that
// was seen, the proof does not hold.
struct Proof {
  double below = 1, permitted = 0, burst = 1;
};

// not_proven: too few messages to tell whether the goal holds. nothing_left: it fails.
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

// SPDX-License-Identifier: Apache-2.0
// Settings that a search may try for a run, as scenario keys, and the remedies of its causes. Reads no
// machine.
#pragma once

#include <functional>
#include <set>
#include <string>
#include <vector>

#include "conditions/conditions.hpp"
#include "explain/explain.hpp"
#include "record/record.hpp"
#include "search/search.hpp"

namespace ontime::search {

// Limits set by the user or this machine.
struct Bounds {
  std::set<std::string> never;  // keys, or their last words: "irq-threads"
  int below_priority = 80;      // of kernel threads, so that they do not preempt the application
  std::vector<int> cpus;        // that threads and interrupts may use; empty: each machine has one CPU
  // Why a machine of the run cannot have this setting, for people; "": it can, or that is not known.
  std::function<std::string(const Setting&)> cannot = [](const Setting&) { return std::string(); };
};

// Keys of all settings that a search may try.
std::vector<std::string> knob_keys();

struct Knobs {
  std::vector<Knob> knobs;  // one without values is tried only where a cause proposes one
  struct LeftOut {
    std::string key, why;
  };
  std::vector<LeftOut> left_out;
};
Knobs knobs_of(const conditions::Run&, const Bounds&);

// Settings of the run that contradict its goal, for people.
std::vector<std::string> contradictions(const conditions::Run&);

// Causes of analyzed messages that are late, lost or slower than `slow_ns` (0: no such limit). A rule, such
// as "above the priority of X", becomes values that satisfy it within the bounds.
std::vector<Finding> findings_of(const explain::Account&, const record::Run&, std::int64_t slow_ns,
                                 const Bounds&);

}  // namespace ontime::search

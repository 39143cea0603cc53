// SPDX-License-Identifier: Apache-2.0
// What may be set for a run, in the words of scenarios, and what the causes of its late messages propose. No
// machine is looked at.
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

// What the user, or this machine, permits.
struct Bounds {
  std::set<std::string> never;  // keys, or their last words: "irq-threads"
  int below_priority = 80;      // of the kernel's threads, which would else keep the application from its CPU
  std::vector<int> cpus;        // on which anything may be put; empty: each machine has one CPU
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

// What in the run itself contradicts its goal, for people.
std::vector<std::string> contradictions(const conditions::Run&);

// Of those messages that were looked at, what made them late, lost or slower than `slow_ns` (0: none is too
// slow). A rule, such as "above the priority of X", becomes the values that keep to it and to the bounds.
std::vector<Finding> findings_of(const explain::Account&, const record::Run&, std::int64_t slow_ns,
                                 const Bounds&);

}  // namespace ontime::search

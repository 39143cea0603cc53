// SPDX-License-Identifier: Apache-2.0
// A run's conditions in words, for what compares them.
#pragma once

#include <array>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "statistics/statistics.hpp"

namespace ontime::report {

inline constexpr std::size_t longest_value = 40;  // of an option; the whole is in JSON and CSV

// Options that an end chose itself where none was requested. Without them runs of ROS 2, or of xdp, cannot be
// told apart.
inline constexpr std::array told_by_facts = {"rmw", "executor", "xdp"};

// A condition of a run.
struct Phrase {
  std::string key;               // as a scenario has it
  std::string text;              // for people
  bool in_labels_alone = false;  // not shown where it is the same in all runs
};

// The conditions of a run in words, one phrase each; only those that its record has.
// A deadline that is the period has none, unless it is told beside others.
std::vector<Phrase> phrases_of(const statistics::Summary&, bool any_deadline = false);
bool is_deadline_the_period(const statistics::Summary&);

// The options of the transports of the controller and of the component.
using Texts = std::map<std::string, std::string>;
std::pair<Texts, Texts> options_of(const statistics::Summary&);

}  // namespace ontime::report

// SPDX-License-Identifier: Apache-2.0
// What was measured, in words, and what tells one run from another.
#pragma once

#include <chrono>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "report/runs.hpp"

namespace ontime::report {

// A label for each run of a group: its transport, and in words the conditions that differ between the runs.
// Repetitions have their number. `separator`: between these conditions.
std::vector<std::string> labels_of(const Group&, std::string_view separator = " ");
// Repetitions of a run have the same label, and only they. `against`: a condition that the runs are drawn
// against, as "payload": it is left out, and runs that differ in nothing else have the same label. A run
// without background topics fits each rate of them, where the other runs have the same topics.
std::vector<std::string> labels_without_repetition(const Group&, std::string_view separator = " ",
                                                   const std::string& against = "");
// Repetitions together, by their label, in the order in which their first one ran.
std::vector<std::pair<std::string, Group>> alike(const Group&);
// Equal labels get the number of their run.
void tell_apart(std::vector<std::string>& labels, const Group&);
std::vector<std::string> labels_apart(const Group&);  // labels_of(), told apart

// The value of a field in a record: "10 ms".
std::string words_of(const conditions::Field&, const nlohmann::json& value);
// The value of a group of keys in a record: of "kernel" "irq-threads 90, ksoftirqd 60". Empty: no words for
// it.
std::string words_of_group(const std::string& key, const nlohmann::json& value);
// A host's requested load: "8 cpu, 2 vm of 64 MiB"; empty without a load.
std::string workers(const conditions::Workers&);

// The conditions that all of them share.
std::vector<std::string> shared_conditions(const Group&);
// "10 ms", where all of them have this time; else `otherwise`.
using ClientTime = std::chrono::nanoseconds roundtrip::ClientOptions::*;
std::string common_duration(const Summaries&, ClientTime, const std::string& otherwise);
std::string limit_of(const Summaries&, const std::string& name, ClientTime);  // "deadline of 10 ms"

// Each condition that is not the same in all of them, by the key that a scenario has for it, and what it was
// in each; empty where it is not known.
struct Differences {
  std::vector<std::string> keys;
  std::vector<std::vector<std::string>> values;  // a row for each of the group, a value for each key
};
Differences differences_between(const Group&);

// The options of the transports at the two ends of runs, a column each: "option.executor",
// "component_option.rmw" if the component's differ. As requested; for RMW and executor without a request, as
// the end reports them.
class OptionColumns {
 public:
  explicit OptionColumns(const Summaries&);
  void add_names(std::vector<std::string>& header) const;
  void add_values(std::vector<std::string>& row, const statistics::Summary&) const;

 private:
  std::set<std::string> controller_, component_;
};

}  // namespace ontime::report

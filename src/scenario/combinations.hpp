// SPDX-License-Identifier: Apache-2.0
// Lists multiply: every combination of their choices is a run.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "conditions/conditions.hpp"
#include "scenario/run_keys.hpp"
#include "scenario/scenario.hpp"

namespace ontime::scenario {

// Gates of a run, by component; "": of all.
using Required = std::map<std::string, std::vector<std::string>>;

// The scenario that runs are made from, which must outlive this, and the amount of runs so far.
struct Origin {
  const std::string& file;
  const Hosts& hosts;
  const RunKeys& keys;
  const Selection& selection;
  std::size_t different = 0, held = 0;  // runs; bytes
};

// The runs of those entries, which stand at `run`. Throws Error: file, line, column, message.
std::vector<Run> runs_of(Origin&, const std::string& id, const YAML::Node& run, const Required&, Entries);

}  // namespace ontime::scenario

// SPDX-License-Identifier: Apache-2.0
// Groups of runs that are shown together.
#pragma once

#include <string>
#include <vector>

#include "report/runs.hpp"

namespace ontime::report {

Group all_of(const Summaries&);
Group last_of(const Summaries&);             // without those that were measured again
std::vector<Group> by_id(const Summaries&);  // in the order of their first runs
std::string quantity_of(const Group&);       // "Round trip", "Age" …; "Time" if they differ
bool all_listened(const Group&);             // to a robot's own messages: without answers and cycles

}  // namespace ontime::report

// SPDX-License-Identifier: Apache-2.0
// A goal such as "p99.9 < 1 ms and late = 0", and the messages of a run that break it.
//
//   goal  = limit { "and" limit }
//   limit = [ "response" ] metric ( "<" | "<=" | "=" ) value     as gates have them: gate/gate.hpp
//
// Each limit is one on a share of messages: of "p99.9 < 1 ms" at most 0.001 of them take longer than 1 ms. So
// a mean is no goal, and of late and lost messages it is a share, or 0.
#pragma once

#include <string>
#include <vector>

#include "gate/gate.hpp"
#include "search/search.hpp"
#include "statistics/statistics.hpp"

namespace ontime::search {

struct Part {
  Limit limit;
  gate::Gate gate;
};
std::vector<Part> goal_of(const std::string& text);  // throws gate::Error, for people

// Approximate number, in runs of `of_run` messages, if no message breaks the limit.
double messages_to_prove(const Limit&, double of_run);

Tally tally_of(const Part&, const statistics::Summary&);

}  // namespace ontime::search

// SPDX-License-Identifier: Apache-2.0
// What iperf3 writes while it runs, in the form that we ask it for (`--format k`).
#pragma once

#include <optional>
#include <string>

namespace ontime::background {

// One of its reports: of a stretch of its own time, in seconds since it began.
struct Interval {
  double from_s, to_s;
  double bits;
};
// Of one line; nothing if it is no such report. The sums at the end, which say "sender" or "receiver", are
// none.
std::optional<Interval> parse_interval(const std::string& line);

}  // namespace ontime::background

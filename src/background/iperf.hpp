// SPDX-License-Identifier: Apache-2.0
// What iperf3 writes while it runs, in the form that we ask it for (`--format k`).
#pragma once

#include <optional>
#include <string>

namespace ontime::background {

// One report: an interval of iperf3's own time, in seconds since its start.
struct Interval {
  double from_s, to_s;
  double bits;
};
// Parses one line; nothing if it is not such a report. The sums at the end ("sender", "receiver") are not.
std::optional<Interval> parse_interval(const std::string& line);

}  // namespace ontime::background

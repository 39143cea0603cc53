// SPDX-License-Identifier: Apache-2.0
// The figures for papers, one file each, and what they share.
#pragma once

#include <algorithm>
#include <optional>
#include <string>
#include <vector>

#include "plot/sheet.hpp"
#include "report/conditions.hpp"

namespace ontime::plot {

using namespace report;  // names of runs are the same as in tables

std::string plot_over_time(const Group&, const Plot&);
std::string plot_ccdf(const Group&, const Plot&);
std::string plot_conditions(const Group&, const Plot&);
std::string plot_against(const Group&, const Plot&);  // the payload, or the rate of background topics

// The runs of one condition: its repetitions.
struct Condition {
  std::string name;   // among all
  std::string label;  // within its id: the transport, and what else tells it from others
  Group runs;
};
std::vector<Condition> conditions_of(const Group&);  // in the order of their first runs
std::vector<std::string> names_of(const Group&);     // of each run: what tells it from the others
// Of each run the line that it is on, where runs are drawn against a condition: "payload".
std::vector<std::string> lines_against(const Group&, const std::string& key);

inline double ms(double ns) { return ns / 1e6; }
inline double ms(std::int64_t ns) { return ms(static_cast<double>(ns)); }
std::optional<double> deadline_ms(const statistics::Summary&);
std::vector<double> deadlines_ms(const Group&);                   // each once
std::string deadline_text(const std::vector<double>& deadlines);  // "deadline 10 ms"
inline constexpr const char* deadline_style = "linewidth 0.8 dashtype 2 linecolor rgb '#666666'";

// From the least to the greatest time of all, deadlines included, with room on both sides. The axis is
// logarithmic and has no place for 0, which ages and periods of a robot's own messages may be: it is drawn at
// the lower end.
struct Range {
  double least_ms, greatest_ms;
  double at(double ns) const { return std::max(ms(ns), least_ms); }
  double at(std::int64_t ns) const { return at(static_cast<double>(ns)); }
};
Range range_of(const Group&, statistics::Times = statistics::Times::round_trip);
double least_positive_ms(const statistics::Summary&);  // to within a bin of its histogram; 1e12 if none is

// Those that were measured to their end and as requested; all, if none was.
Group sound_of(const Group&);

struct Counts {
  std::uint64_t sent = 0, late = 0, lost = 0, skipped_cycles = 0;
  std::uint64_t not_in_time = 0;                // of all cycles
  bool differs_by_response = false;             // which makes more of them late
  std::uint64_t unrecorded = 0;                 // of those sent: their times are unknown
  bool knows_late = false, knows_loss = false;  // of a run at least
};
Counts counts_of(const Group&);
std::string text_of(const Counts&);           // "6 late, 0 lost of 1,945"
std::string not_in_time_text(const Counts&);  // "178 of 800 cycles not in time"

}  // namespace ontime::plot

// SPDX-License-Identifier: Apache-2.0
// What the paper measured: "Towards a distributed and real-time framework for robots: Evaluation of ROS 2.0
// communications for real-time robotic applications", Gutiérrez, San Vicente et al., 2018, its tables.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "record/record.hpp"

namespace ontime::report {

extern const char* const paper_csv;  // paper.csv, as it was when this was built

struct PaperRow {
  std::string test;     // "Test1.A"
  std::string caption;  // "System under load with RT settings": in quotes, if it has a comma
  std::string dds;      // "DDS 1": the paper does not say which
  std::int64_t min_us = 0, avg_us = 0, max_us = 0;
  std::uint64_t missed_deadlines = 0, lost = 0, messages = 0;
};
const std::vector<PaperRow>& paper();
inline constexpr const char* paper_legend =
    "paper's: Gutiérrez, San Vicente et al. (2018), two machines, DDS 1 to 3, 10 minutes (Test5: 12 hours). "
    "The paper's load: 8 workers of each kind on the controller, 2 on the component.";

// The rows that are comparable with a run: the same id, period, deadline, payload, schedule, real-time
// settings and traffic, and a load where the paper has one. (Another test may have the same name.) The size
// of the load and the duration may differ.
std::vector<PaperRow> paper_rows(const record::Asked&);

}  // namespace ontime::report

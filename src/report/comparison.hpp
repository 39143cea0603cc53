// SPDX-License-Identifier: Apache-2.0
// What is behind a comparison's forms.
#pragma once

#include <string>
#include <vector>

#include "report/report.hpp"
#include "table/table.hpp"

namespace ontime::report {

// What was not the same on both sides, beside what was measured: "controller kernel_release", and what it was
// on either; several values where repetitions have several.
struct Difference {
  std::string what, from, to;
};
std::vector<Difference> differences(const Comparison::Runs& from, const Comparison::Runs& to);

table::Page page_of(const Comparison&, const std::vector<gate::Judgement>&);
nlohmann::ordered_json json_of(const Comparison&, const std::vector<gate::Judgement>&);
std::string csv_of(const Comparison&);

}  // namespace ontime::report

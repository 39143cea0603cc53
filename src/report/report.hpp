// SPDX-License-Identifier: Apache-2.0
// Output about runs, for users and programs: the answer, the paper's table with percentiles added, threads,
// layers. Comparisons, explanations and exports have their own headers.
// Ordinary thread; returns text, prints nothing.
#pragma once

#include <string>
#include <vector>

#include "report/answer.hpp"
#include "statistics/statistics.hpp"

namespace ontime::report {

enum class Format { table, json, csv, markdown, latex, html };

// Every table of all runs, one row a run; as HTML the tables alone. docs/reference/json.md describes the
// JSON; it is stable. `width`: of a terminal, for Format::table.
std::string render(const std::vector<statistics::Summary>&, Format, const Origin& = {},
                   std::size_t width = 100);
// The first screen instead, where the form is Format::table.
std::string render_answer(const std::vector<statistics::Summary>&, Format, const Origin&, std::size_t width);
// The threads of each run as the kernel reports them: policy, priority, affinity, faults, switches.
std::string render_threads(const std::vector<statistics::Summary>&, Format, std::size_t width = 100);
// What each layer costs a message, for runs that name a baseline: a waterfall.
std::string render_layers(const std::vector<statistics::Summary>&, Format, std::size_t width = 100);

// Settings that an end requested and its machine denied, for users; equal ones together.
std::vector<std::string> refusals_of(const record::Host& end);

}  // namespace ontime::report

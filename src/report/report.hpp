// SPDX-License-Identifier: Apache-2.0
// Output about runs, for users and programs: the answer, the paper's table with percentiles added, threads,
// layers; and results in formats of other programs. Comparisons and explanations have their own headers.
// Ordinary thread; returns text, prints nothing.
#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "gate/gate.hpp"
#include "record/record.hpp"
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

// Every sample of these runs, a line each, in order of run and message; docs/reference/results-file.md names
// the columns. `write` is given pieces of the text: memory does not grow with the number of samples.
enum class SampleFormat { csv, jsonl };
void export_samples(const record::Reader&, const std::vector<record::Run>&, SampleFormat,
                    const std::function<void(std::string_view)>& write);

// Results of gates for a CI: JUnit XML as Jenkins, GitLab and GitHub Actions read it. A missed gate is a
// failure; a gate that cannot be judged is an error.
std::string junit(const std::vector<gate::Judgement>&);

}  // namespace ontime::report

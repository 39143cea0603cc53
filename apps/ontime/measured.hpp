// SPDX-License-Identifier: Apache-2.0
// What commands that run scenarios share: flags that choose runs, and the output afterwards.
#pragma once

#include <string>
#include <vector>

#include "campaign/campaign.hpp"
#include "command.hpp"
#include "gates.hpp"
#include "report/report.hpp"
#include "statistics/statistics.hpp"
#include "terminal.hpp"

namespace ontime::app {

// --only, --transports, --duration and --explain.
struct Choice {
  campaign::Selection selection;
  std::string duration;
  campaign::Selection checked() const;  // throws Error that names the flag
};
void add_choice(Command&, Choice&);
void add_explain_flag(Command&, Choice&);  // --explain, for runs that need not be explained
void add_cable(Command&, Choice&);         // --cable, for runs on this machine

// A new file in the current folder, named after the scenario and the time.
std::string new_results_file(const std::string& scenario);

// Throws Error{2} if the file exists and `resume` is false.
void check_results(const std::string& file, bool resume);

// For --resume. Throws Error{2}, with what differs, if the run was measured on another machine or kernel.
void check_machines(const record::Run&, const record::ByName<record::Machine>& now);

// The runs in the results from `known` on, the exit code of measuring them, and why the measurement is
// unfinished; "": it is complete.
struct Measured {
  record::Writer& writer;
  const std::string& results;
  std::size_t known;
  int code;
  std::string unfinished{};
  std::string to_go_on{};  // the command line; "": nothing is left to measure
};
// Shows and judges the runs, and writes the page. Says how to go on, once. Missed requirements go into the
// results, too. Returns the exit code.
int show_measured(const Measured&, report::Format, bool full, const GateFlags&,
                  const std::vector<gate::Gate>&, Terminal&);

// Why messages of the runs from `known` on were late. JSON and CSV must stay one document.
bool is_for_people(report::Format);
void explain_new(record::Writer&, std::size_t known, report::Format);

// Writes the page of a results file, with all its runs: "demo.html" beside "demo.ontime". Returns its name.
// Replaces an earlier page, but throws for any other file, and if it cannot be written.
std::string write_page_beside(const std::string& results, const record::Reader&,
                              const std::vector<statistics::Summary>&);

// The command line that continues this measurement. `named`: whether the user stated --results.
std::string to_go_on(const std::string& results, bool named, bool resumes);

}  // namespace ontime::app

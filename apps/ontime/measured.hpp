// SPDX-License-Identifier: Apache-2.0
// What commands that carry out scenarios have in common: what they take of them, and what they show
// afterwards.
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
void add_cable(Command&, Choice&);  // --cable, of what is measured on this machine

// Beside the user, named after what was run and when; an earlier one is never added to.
std::string new_results_file(const std::string& scenario);

// Throws Error where a new file cannot be made there: 2 if there is one and its runs are not to be resumed, 3
// if its folder cannot be written.
void check_results(const std::string& file, bool resume);

// Those that are in the results from `known` on, the exit code of measuring them, and why not all were that
// were to be; "": they were.
struct Measured {
  record::Writer& writer;
  const std::string& results;
  std::size_t known;
  int code;
  std::string unfinished{};
};
// Shows them, judges them, and makes the page; what does not hold goes into the results too. Returns the exit
// code.
int show_measured(const Measured&, report::Format, bool full, const GateFlags&,
                  const std::vector<gate::Gate>&, Terminal&);

// The page of a results file, of these runs, all that are in it. Named after it, "demo.html" beside
// "demo.ontime"; returns that name. An earlier page is replaced, but no other file: then, and where it cannot
// be written, it throws.
std::string write_page_beside(const std::string& results, const record::Reader&,
                              const std::vector<statistics::Summary>&);

// How the same command measures the runs that are missing in the results. `named`: whether it names them.
std::string to_go_on(const std::string& results, bool named, bool resumes);

}  // namespace ontime::app

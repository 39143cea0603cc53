// SPDX-License-Identifier: Apache-2.0
// --only: the one way to name runs of a results file, by their ids or their numbers.
#pragma once

#include <string>
#include <vector>

#include "command.hpp"
#include "statistics/statistics.hpp"

namespace ontime::app {

// `older`: an older name of the flag that still works, such as ",--runs".
void add_only(Command&, std::vector<std::string>& words, const std::string& older = "");

// The runs of the file with these ids or numbers; without words, all runs. Throws Error{2} for a word that
// names no run, with a list of the runs.
std::vector<record::Run> chosen_runs(const record::Reader&, const std::string& file,
                                     const std::vector<std::string>& words);
std::vector<statistics::Summary> chosen_summaries(const record::Reader&, const std::string& file,
                                                  const std::vector<std::string>& words);
// Shows its progress where it takes seconds.
std::vector<statistics::Summary> summaries_of(const record::Reader&, const std::vector<record::Run>&);

}  // namespace ontime::app

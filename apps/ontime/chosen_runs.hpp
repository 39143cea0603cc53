// SPDX-License-Identifier: Apache-2.0
// --only: the one way to name runs of a results file, by their ids or their numbers.
#pragma once

#include <string>
#include <vector>

#include "command.hpp"
#include "statistics/statistics.hpp"

namespace ontime::app {

// `older`: a flag that meant the same, and stays: ",--runs".
void add_only(Command&, std::vector<std::string>& words, const std::string& older = "");

// Those of the file that have one of these ids or numbers, all where there are no words. Throws Error{2} that
// names a word which no run has, and what there is instead.
std::vector<record::Run> chosen_runs(const record::Reader&, const std::string& file,
                                     const std::vector<std::string>& words);
std::vector<statistics::Summary> chosen_summaries(const record::Reader&, const std::string& file,
                                                  const std::vector<std::string>& words);

}  // namespace ontime::app

// SPDX-License-Identifier: Apache-2.0
// Runs, as programs read them and as people do.
#pragma once

#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "report/page.hpp"
#include "statistics/statistics.hpp"

namespace ontime::report {

using Summaries = std::vector<statistics::Summary>;

nlohmann::ordered_json json_of(const statistics::Summary&);  // docs/json.md
std::string csv_of(const Summaries&);
Page page_of(const Summaries&);

// How sure the figures of runs are, by their labels; without a title. No rows where nothing is known of it.
Table certainty_table(const std::vector<std::string>& labels, const std::vector<const statistics::Summary*>&);
// What a response is made of, each by itself: a stall of our own thread is none of the network's.
Table stages_table(const std::vector<std::string>& labels, const std::vector<const statistics::Summary*>&);
void add_certainty(nlohmann::ordered_json& run, const statistics::Summary&);

// What a run must not be read without: whatever went wrong or was counted beside the table. Empty if nothing
// was.
std::string remarks(const statistics::Summary&);
// What these runs asked of their machines and did not get, each once.
std::vector<std::string> refusals(const Summaries&);

nlohmann::ordered_json threads_json_of(const Summaries&);
std::string threads_csv_of(const Summaries&);
Page threads_page_of(const Summaries&);

// What each layer costs, of runs that say what they add to.
nlohmann::ordered_json layers_json_of(const Summaries&);
std::string layers_csv_of(const Summaries&);
Page layers_page_of(const Summaries&);

}  // namespace ontime::report

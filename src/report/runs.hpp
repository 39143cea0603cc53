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

// A percentile needs one value above it to say anything, and ten to be more than a glimpse: below that it is
// "-", or marked "~". `one_in`: how many values have one above it.
std::string percentile(const statistics::Distribution&, std::int64_t ns, std::uint64_t one_in);

// What a run must not be read without: whatever went wrong or was counted beside the table. Empty if nothing
// was.
std::string remarks(const statistics::Summary&);
// What these runs asked of their machines and did not get, each once.
std::vector<std::string> refusals(const Summaries&);

// Runs of an id that were imported: what is known of them, and what is not.
Table imported_table_of(const std::vector<const statistics::Summary*>&);
nlohmann::ordered_json imported_json_of(const statistics::Summary&);  // null, if it was measured

nlohmann::ordered_json threads_json_of(const Summaries&);
std::string threads_csv_of(const Summaries&);
Page threads_page_of(const Summaries&);

// What each layer costs, of runs that say what they add to.
nlohmann::ordered_json layers_json_of(const Summaries&);
std::string layers_csv_of(const Summaries&);
Page layers_page_of(const Summaries&);

}  // namespace ontime::report

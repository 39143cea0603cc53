// SPDX-License-Identifier: Apache-2.0
// The result of `ontime tune search`: for a terminal, as JSON, and as a page with a picture.
#pragma once

#include <string>

#include <nlohmann/json.hpp>

#include "search/keep.hpp"
#include "search/knobs.hpp"
#include "search/search.hpp"

namespace ontime::app {

struct SearchReport {
  const search::Problem& problem;
  const search::Outcome& outcome;
  const std::vector<search::Knobs::LeftOut>& left_out;
  std::string stopped;    // why the search stopped early, for people; "": it did not
  std::string simulated;  // simulator of the machines; "": real machines
  std::string scenario, results, page;
  search::Kept kept;
};

std::string text_of(const SearchReport&);
nlohmann::ordered_json json_of(const SearchReport&);
std::string page_of(const SearchReport&);

std::string goal_of(const search::Problem&);  // its limits: "p99.9 < 1 ms and response late = 0"
std::string words_of(const search::Set&);     // "kernel.ksoftirqd: 60, realtime: on"; "no settings" of none

}  // namespace ontime::app

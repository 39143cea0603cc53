// SPDX-License-Identifier: Apache-2.0
// The page: verdict, table, figures of every message, settings. One file that opens anywhere.
// Ordinary thread; returns text, prints nothing.
#pragma once

#include <string>
#include <vector>

#include "record/record.hpp"
#include "statistics/statistics.hpp"

namespace ontime::page {

// It reads the samples once more. `name` is what the page is of, such as the results file's name.
std::string page_of(const record::Reader&, const std::vector<statistics::Summary>&, const std::string& name);

}  // namespace ontime::page

// SPDX-License-Identifier: Apache-2.0
// The page: verdict, table, figures of every message, settings. One file that opens anywhere.
// Ordinary thread; returns text, prints nothing.
#pragma once

#include <string>
#include <vector>

#include "record/record.hpp"
#include "report/answer.hpp"
#include "statistics/statistics.hpp"

namespace ontime::page {

// It reads the samples once more. The page names `origin.file`.
std::string page_of(const record::Reader&, const std::vector<statistics::Summary>&, const report::Origin&);

}  // namespace ontime::page

// SPDX-License-Identifier: Apache-2.0
// The page of a results file.
#pragma once

#include <string>
#include <vector>

#include "statistics/statistics.hpp"

namespace ontime::app {

// Of these runs, all that are in the results. Named after those, "demo.html" beside "demo.ontime"; returns
// that name. An earlier page is replaced, but no other file: then, and where it cannot be written, it throws.
std::string write_page_beside(const std::string& results, const record::Reader&,
                              const std::vector<statistics::Summary>&);

}  // namespace ontime::app

// SPDX-License-Identifier: Apache-2.0
// Remarks on what the link carried and lost. An empty text: there is nothing to say.
#pragma once

#include <string>
#include <vector>

#include "report/runs.hpp"

namespace ontime::report {

// "12 at the component, 3 at the controller": what each end's own reader lost.
std::string losses_text(const record::Outcome&, std::uint64_t record::Losses::*kind, const char* where);
Remark traffic_remark(const record::Outcome&);
Remark background_remark(const record::Outcome&);
std::string drops_text(const record::Outcome&);
std::string link_faults_text(const record::Outcome&);
std::string missed_launches_text(const record::Outcome&);
std::vector<std::string> other_traffic(const statistics::Summary&);

}  // namespace ontime::report

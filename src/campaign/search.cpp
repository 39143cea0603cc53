// SPDX-License-Identifier: Apache-2.0
#include "campaign/search.hpp"

#include "gate/gate.hpp"
#include "record/record.hpp"

namespace ontime::campaign {

// It may come from a file that somebody else wrote: what is not there, or is something else, is null.
bool ends_search(const nlohmann::json& asked, const nlohmann::json& outcome) {
  using record::at;
  if (!at(outcome, "error").is_null()) return true;
  for (const auto* counter : {"late", "lost", "skipped_cycles"})
    if (const auto& count = at(outcome, counter); !count.is_null() && count != 0) return true;
  return !gate::absent(asked, outcome).empty();
}

}  // namespace ontime::campaign

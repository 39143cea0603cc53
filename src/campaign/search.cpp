// SPDX-License-Identifier: Apache-2.0
#include "campaign/search.hpp"

#include <cstdint>

namespace ontime::campaign {

bool ends_search(const nlohmann::json& outcome) {
  if (outcome.contains("error")) return true;
  for (const auto* counter : {"late", "lost", "skipped_cycles"})
    if (outcome.value(counter, std::uint64_t{0}) > 0) return true;
  for (const auto* beside : {"neighbours", "traffic"})
    if (const auto ways = outcome.value(beside, nlohmann::json()); ways.is_object())
      for (const auto& way : ways)
        if (way.at("short").get<bool>()) return true;
  return false;
}

}  // namespace ontime::campaign

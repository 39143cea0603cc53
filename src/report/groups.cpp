// SPDX-License-Identifier: Apache-2.0
#include "report/groups.hpp"

#include <algorithm>
#include <map>

#include "gate/gate.hpp"
#include "report/words.hpp"

namespace ontime::report {

Group all_of(const Summaries& summaries) {
  Group all;
  for (const auto& summary : summaries) all.push_back(&summary);
  return all;
}

Group last_of(const Summaries& summaries) {
  auto last = all_of(summaries);
  std::erase_if(last, [&](const auto* run) { return gate::is_superseded(*run, summaries); });
  return last;
}

std::vector<Group> by_id(const Summaries& summaries) {
  std::vector<Group> groups;
  std::map<std::string, std::size_t> places;
  for (const auto& summary : summaries) {
    const auto [place, is_new] = places.try_emplace(word(summary.run.asked.id), groups.size());
    if (is_new) groups.emplace_back();
    groups[place->second].push_back(&summary);
  }
  return groups;
}

std::string quantity_of(const Group& group) {
  const std::string first = quantity_of(group.front()->run.asked);
  const bool same = std::ranges::all_of(
      group, [&](const auto* summary) { return quantity_of(summary->run.asked) == first; });
  return same ? first : "Time";
}

bool all_listened(const Group& group) {
  return std::ranges::all_of(group, [](const auto* summary) { return summary->run.asked.is_listened(); });
}

}  // namespace ontime::report

// SPDX-License-Identifier: Apache-2.0
#include "campaign/campaign.hpp"

namespace ontime::campaign {
namespace {

using nlohmann::json;

json differences(const json& one, const json& other) {
  auto different = json::object();
  for (const auto& [key, value] : other.items())
    if (one.value(key, json()) != value) different[key] = value;
  for (const auto& [key, value] : one.items())
    if (!other.contains(key)) different[key] = "none";
  different.erase("beside");  // words for what is here
  return different;
}

}  // namespace

std::vector<json> asked(const Together& runs, const Hosts& hosts) {
  std::vector<json> all, conditions;
  for (const auto& run : runs)
    conditions.push_back(record::conditions_of(all.emplace_back(asked(run, hosts))));
  for (std::size_t i = 0; i < runs.size(); ++i)
    for (std::size_t other = 0; other < runs.size(); ++other)
      if (i != other) all[i]["others"][runs[other].component] = differences(conditions[i], conditions[other]);
  return all;
}

}  // namespace ontime::campaign

// SPDX-License-Identifier: Apache-2.0
#include "resumed.hpp"

#include <fmt/format.h>

#include "campaign/campaign.hpp"
#include "statistics/statistics.hpp"

namespace ontime::app {
namespace {

using nlohmann::json;
using record::at;

bool same(const json& one, const json& other, std::initializer_list<const char*> names) {
  for (const auto* name : names)
    if (at(one, name) != at(other, name)) return false;
  return true;
}

}  // namespace

Resumed::Resumed(const record::Reader& reader) {
  for (auto& run : reader.runs()) {
    const auto key = run.key;
    if (statistics::is_complete(run)) complete_.emplace(key, std::move(run));
  }
}

const json* Resumed::find(const json& asked, const json& machines) const {
  const auto [first, last] = complete_.equal_range(record::key_of(asked));
  for (auto known = first; known != last; ++known) {
    const auto& run = known->second;
    if (!same(run.asked.document, asked, {"repetition", "scenario", "ontime"})) continue;
    for (const auto& [host, machine] : machines.items())
      if (!same(record::find(run.outcome.hosts, host).machine.document, machine,
                {"hostname", "kernel_release", "kernel_version", "cpu_model"}))
        throw campaign::Error(
            2,
            fmt::format(
                "--resume: run {} of these results is of another machine, or of another kernel than the {} "
                "now is: one suite is of one. Begin a new file of results",
                run.number, host));
    return &run.outcome.document;
  }
  return nullptr;
}

}  // namespace ontime::app

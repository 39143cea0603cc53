// SPDX-License-Identifier: Apache-2.0
#include "search/keep.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "settings/settings.hpp"

namespace ontime::search {
namespace {

// As `ontime tune` takes them: sizes in bytes.
settings::Wishes wishes_of(const Set& set) {
  conditions::Run run;
  for (const auto& key : conditions::keys())
    if (const auto found = set.find(key.path); key.path.starts_with("kernel.") && found != set.end())
      key.set(run, found->second);
  return run.kernel;
}

// At boot. The namespaces of a run have interfaces of their own, which are not there then.
std::string interface_of(const conditions::Hosts& hosts, const settings::Wishes& wishes) {
  const auto table = settings::table();
  if (std::none_of(table.begin(), table.end(),
                   [&](const auto& one) { return one.of_interface && wishes.contains(one.name); }))
    return "";
  return hosts.controller.interface.empty() ? "INTERFACE" : hosts.controller.interface;
}

}  // namespace

Kept keep(const scenario::Scenario& scenario, const Set& set, const std::string& program) {
  Kept kept;
  if (set.empty()) return kept;
  kept.scenario = "defaults:\n";
  for (const auto& [key, value] : set) kept.scenario += fmt::format("  {}: {}\n", key, value);
  const auto wishes = wishes_of(set);
  if (wishes.empty()) return kept;
  const settings::Link link{interface_of(scenario.hosts, wishes), ""};
  kept.command = "ontime tune apply";
  for (const auto& [name, value] : wishes) kept.command += fmt::format(" --set {}={}", name, value);
  if (!link.interface.empty()) kept.command += " --interface " + link.interface;
  kept.command += " --print systemd";
  try {
    kept.unit = settings::at_every_boot(settings::Form::systemd, wishes, {}, link, program);
  } catch (const settings::Error& error) {
    kept.no_unit = error.what();
  }
  return kept;
}

}  // namespace ontime::search

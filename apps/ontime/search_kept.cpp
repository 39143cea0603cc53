// SPDX-License-Identifier: Apache-2.0
#include "search_kept.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "campaign/ssh.hpp"
#include "settings/settings.hpp"

namespace ontime::app {
namespace {

constexpr std::string_view kernel = "kernel.";

// As `ontime tune` takes them: sizes in bytes.
settings::Wishes wishes_of(const search::Set& set) {
  campaign::Run run;
  for (const auto& key : campaign::keys())
    if (const auto found = set.find(key.path); key.path.starts_with(kernel) && found != set.end())
      key.set(run, found->second);
  return run.kernel;
}

// The interface at boot. Of namespaces, which a run makes, the robot's own takes the place.
std::string interface_of(const campaign::Scenario& scenario, const settings::Wishes& wishes) {
  const auto table = settings::table();
  if (std::none_of(table.begin(), table.end(),
                   [&](const auto& one) { return one.of_interface && wishes.contains(one.name); }))
    return "";
  const auto& stated = scenario.hosts.controller.interface;
  return stated.empty() ? "INTERFACE" : stated;
}

}  // namespace

KeptSettings kept_settings(const campaign::Scenario& scenario, const search::Set& set) {
  KeptSettings kept;
  if (set.empty()) return kept;
  kept.scenario = "defaults:\n";
  for (const auto& [key, value] : set) kept.scenario += fmt::format("  {}: {}\n", key, value);
  const auto wishes = wishes_of(set);
  if (wishes.empty()) return kept;
  const settings::Link link{interface_of(scenario, wishes), ""};
  std::vector<std::string> words{"ontime", "tune", "apply"};
  for (const auto& [name, value] : wishes)
    words.insert(words.end(), {"--set", fmt::format("{}={}", name, value)});
  if (!link.interface.empty()) words.insert(words.end(), {"--interface", link.interface});
  words.insert(words.end(), {"--print", "systemd"});
  kept.command = campaign::quoted(words);
  try {
    kept.unit = settings::at_every_boot(settings::Form::systemd, wishes, {}, link, orders::this_program());
  } catch (const settings::Error& error) {
    kept.no_unit = error.what();
  }
  return kept;
}

}  // namespace ontime::app

// SPDX-License-Identifier: Apache-2.0
#include "search/keep.hpp"

#include <algorithm>

#include <fmt/format.h>

namespace ontime::search {
namespace {

constexpr const char* to_fill_in = "INTERFACE";  // the user replaces it in the printed unit

// The run's own values, overridden by the set.
settings::Wishes wishes_of(conditions::Run run, const Set& set) {
  for (const auto& key : conditions::keys())
    if (const auto found = set.find(key.path); key.path.starts_with("kernel.") && found != set.end())
      key.set(run, found->second);
  return run.kernel;
}

bool is_of_interface(const settings::Wishes& wishes) {
  return std::ranges::any_of(settings::table(),
                             [&](const auto& one) { return one.of_interface && wishes.contains(one.name); });
}

// One for each host, or one for all where all have the same, or need none.
Links links_of(const Links& known, const settings::Wishes& wishes) {
  if (!is_of_interface(wishes)) return {{"", {}}};
  if (known.empty()) return {{"", {to_fill_in, ""}}};
  auto links = known;
  for (auto& [host, link] : links)
    if (link.interface.empty()) link.interface = to_fill_in;
  const auto& first = links.begin()->second;
  const bool is_one = std::all_of(links.begin(), links.end(), [&](const auto& one) {
    return one.second.interface == first.interface && one.second.network_namespace == first.network_namespace;
  });
  return is_one ? Links{{"", first}} : links;
}

Unit unit_of(const std::string& host, const settings::Link& link, const settings::Wishes& wishes,
             const std::string& program) {
  Unit unit{host, settings::command_to_apply("ontime", wishes, link) + " --print systemd", "", ""};
  try {
    unit.text = settings::at_every_boot(settings::Form::systemd, wishes, {}, link, program);
  } catch (const settings::Error& error) {
    unit.why_not = error.what();
  }
  return unit;
}

}  // namespace

Kept keep(const conditions::Run& run, const Set& set, const Links& links, const std::string& program) {
  Kept kept;
  if (set.empty()) return kept;
  kept.run = run.id;
  for (const auto& [key, value] : set) kept.scenario += fmt::format("    {}: {}\n", key, value);
  if (run.isolation.any())
    kept.left_out =
        "isolation.* of this run, because only `ontime run` applies it. Fix: reserve the CPUs from boot, "
        "with isolcpus= on the kernel's command line (`ontime check` prints it).";
  const auto wishes = wishes_of(run, set);
  if (wishes.empty()) return kept;
  for (const auto& [host, link] : links_of(links, wishes)) {
    kept.units.push_back(unit_of(host, link, wishes, program));
    if (link.interface == to_fill_in)
      kept.fill_in = fmt::format(
          "Replace {} with the robot's network interface for these messages (`ip link` lists them).",
          to_fill_in);
  }
  return kept;
}

}  // namespace ontime::search

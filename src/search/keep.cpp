// SPDX-License-Identifier: Apache-2.0
#include "search/keep.hpp"

#include <algorithm>
#include <utility>

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

// One for each host, or one for all where all have the same.
Places without_repetition(Places places, const settings::Wishes& wishes) {
  for (auto& [host, place] : places)
    if (!is_of_interface(wishes))
      place.link = {};
    else if (place.link.interface.empty())
      place.link.interface = to_fill_in;
  auto one = places.begin()->second;
  for (const auto& [host, place] : places) {
    if (place.link.interface != one.link.interface ||
        place.link.network_namespace != one.link.network_namespace || place.program != one.program)
      return places;
    one.is_here = one.is_here || place.is_here;
  }
  return {{"", one}};
}

Unit unit_of(const std::string& host, const Place& place, const settings::Wishes& wishes) {
  Unit unit{host, settings::command_to_apply("ontime", wishes, place.link) + " --print systemd", "", ""};
  if (place.program.empty()) {
    unit.why_not = "ontime is there only for the search. Fix: install it, and give that command there";
    return unit;
  }
  try {
    unit.text = settings::at_every_boot(settings::Form::systemd, wishes, {}, place.link,
                                        {place.program, place.is_here});
  } catch (const settings::Error& error) {
    unit.why_not = error.what();
  }
  return unit;
}

}  // namespace

Kept keep(const conditions::Run& run, const Set& set, Places places) {
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
  for (const auto& [host, place] : without_repetition(std::move(places), wishes)) {
    kept.units.push_back(unit_of(host, place, wishes));
    if (place.link.interface == to_fill_in)
      kept.fill_in = fmt::format(
          "Replace {} with the robot's network interface for these messages (`ip link` lists them).",
          to_fill_in);
  }
  return kept;
}

}  // namespace ontime::search

// SPDX-License-Identifier: Apache-2.0
// How the settings that a search found are kept: text to paste. Ordinary thread; changes nothing.
#pragma once

#include <string>

#include "scenario/scenario.hpp"
#include "search/search.hpp"

namespace ontime::search {

struct Kept {
  std::string scenario;  // "defaults:" of a scenario, in YAML; "": nothing is to be kept
  std::string command;   // that prints the unit; "": no setting is the kernel's
  std::string unit;  // what it prints: a unit of systemd for every boot, with INTERFACE where it is not known
  std::string no_unit;  // why there is none, for people; "": there is one, or none is needed
};
// `program`: what the unit starts.
Kept keep(const scenario::Scenario&, const Set&, const std::string& program);

}  // namespace ontime::search

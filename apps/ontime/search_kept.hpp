// SPDX-License-Identifier: Apache-2.0
// How the settings that a search found are kept: text to paste. Ordinary thread; changes nothing.
#pragma once

#include <string>

#include "campaign/campaign.hpp"
#include "search/search.hpp"

namespace ontime::app {

struct KeptSettings {
  std::string scenario;  // "defaults:" of a scenario, in YAML; "": nothing is to be kept
  std::string command;   // that prints the unit; "": no setting is the kernel's
  std::string unit;      // what it prints: a unit of systemd for every boot
  std::string no_unit;   // why there is none, for people; "": there is one, or none is needed
};
KeptSettings kept_settings(const campaign::Scenario&, const search::Set&);

}  // namespace ontime::app

// SPDX-License-Identifier: Apache-2.0
// What the machines of a scenario are known to lack before a run: of hosts on this machine. Ordinary thread;
// changes nothing.
#pragma once

#include <functional>
#include <string>

#include "campaign/campaign.hpp"
#include "search/search.hpp"

namespace ontime::app {

// Why the scenario's run cannot have a setting here, for people; "": it can, or only its run shows it.
std::function<std::string(const search::Setting&)> lacks_of(const campaign::Scenario&);

}  // namespace ontime::app

// SPDX-License-Identifier: Apache-2.0
// Reads a scenario's hosts, components and wire.
#pragma once

#include <yaml-cpp/yaml.h>

#include "scenario/document.hpp"
#include "scenario/scenario.hpp"

namespace ontime::scenario {

// From a scenario's `hosts`, `components` and `wire`, if stated. Throws Error with file, line and column.
Hosts hosts_of(const std::string& file, const YAML::Node& hosts, const YAML::Node& components,
               const YAML::Node& wire, Notices&);

// Joins the namespaces of `hosts` by these two interfaces of this machine. Throws Error for other hosts, or
// if there are not two interfaces.
void lay_cable(const std::string& file, const std::vector<std::string>& interfaces, Hosts& hosts);

}  // namespace ontime::scenario

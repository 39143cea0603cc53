// SPDX-License-Identifier: Apache-2.0
// Reads a scenario's hosts, components and wire.
#pragma once

#include <optional>

#include <yaml-cpp/yaml.h>

#include "scenario/document.hpp"
#include "scenario/scenario.hpp"

namespace ontime::scenario {

// From a scenario's `hosts` and `components`, if stated. Throws Error with file, line and column.
Hosts hosts_of(const std::string& file, const std::optional<YAML::Node>& hosts,
               const std::optional<YAML::Node>& components, Notices&);

// Sets the wire between the two namespaces of `hosts`. Throws Error with file, line and column.
void lay_wire(const std::string& file, const YAML::Node& wire, Hosts& hosts);

// Joins the namespaces of `hosts` by these two interfaces of this machine. Throws Error for other hosts, or
// if there are not two interfaces.
void lay_cable(const std::string& file, const std::vector<std::string>& interfaces, Hosts& hosts);

}  // namespace ontime::scenario

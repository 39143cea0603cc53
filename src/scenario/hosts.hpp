// SPDX-License-Identifier: Apache-2.0
// Where the ends are, as a scenario says it.
#pragma once

#include <optional>

#include <yaml-cpp/yaml.h>

#include "scenario/document.hpp"
#include "scenario/scenario.hpp"

namespace ontime::scenario {

// Of a scenario's `hosts` and `components`, as far as they are there. Throws Error with file, line and
// column.
Hosts hosts_of(const std::string& file, const std::optional<YAML::Node>& hosts,
               const std::optional<YAML::Node>& components, Notices&);

// That the two namespaces of `hosts` are joined by such a wire. Throws Error with file, line and column.
void lay_wire(const std::string& file, const YAML::Node& wire, Hosts& hosts);

// That the namespaces of `hosts` are joined by these two interfaces of this machine. Throws Error where
// hosts are others, or interfaces not two.
void lay_cable(const std::string& file, const std::vector<std::string>& interfaces, Hosts& hosts);

}  // namespace ontime::scenario

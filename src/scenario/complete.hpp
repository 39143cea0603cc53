// SPDX-License-Identifier: Apache-2.0
// What only several keys together can tell. All throw std::invalid_argument, for people.
#pragma once

#include <string>

#include "scenario/scenario.hpp"

namespace ontime::scenario {

// Of concurrent traffic, the link's faults, and ordinary topics beside the critical one.
void complete_network(Run&);
void complete_neighbours(const Run&);
bool has_no_topics(const std::string& transport);
// That ROS 2 would take the names of all topics.
void check_topics(const transport::Config&);

}  // namespace ontime::scenario

// SPDX-License-Identifier: Apache-2.0
// What the table of keys is made from. All throw std::invalid_argument, for people.
#pragma once

#include <chrono>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include <fmt/format.h>

#include "campaign/campaign.hpp"

namespace ontime::campaign {

template <typename Value>
Value one_of(const std::optional<Value>& value, const std::string& text, const std::string& values) {
  if (!value) throw std::invalid_argument(fmt::format("'{}' is not one of {}", text, values));
  return *value;
}

// Whether its messages go by no IP, which the kernel's packet filter counts; and past all that the kernel
// does to what it sends and receives.
bool is_below_ip(const std::string& transport);
bool is_past_the_kernel(const std::string& transport);
bool any_past_the_kernel(const Run&);  // of its two ends

// Of concurrent traffic and of the link's faults, and what only all of them together can tell.
std::vector<Key> network_keys();
void complete_network(Run&);
// Of ordinary topics beside the critical one; likewise.
std::vector<Key> neighbour_keys();
void complete_neighbours(const Run&);

std::size_t payload_of(const std::string& text);
std::optional<Traffic::Direction> direction_of(const std::string& word);
// That ROS 2 would take the names of all topics.
void check_topics(const transport::Config&);

}  // namespace ontime::campaign

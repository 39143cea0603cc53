// SPDX-License-Identifier: Apache-2.0
// What is seen of other nodes, and of what they sent and we did not get.
#pragma once

#include <string>

#include <rclcpp/rclcpp.hpp>

#include "transport/transport.hpp"

namespace ontime::transport::ros2 {

// Throws Error if another node of that name answers within a short while. ROS 2 itself lets both live, and
// its tools then confuse them.
void refuse_namesake(const rclcpp::Node& node);

// What the RMW tells of messages that the subscription was not given.
Losses losses_of(const std::string& rmw, const rclcpp::SubscriptionBase& subscription);

// For people.
std::string seen(const Config& config, rclcpp::Node& node, const rclcpp::PublisherBase& publisher,
                 const rclcpp::SubscriptionBase& subscription, Matched matched);

}  // namespace ontime::transport::ros2

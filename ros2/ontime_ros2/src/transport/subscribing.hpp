// SPDX-License-Identifier: Apache-2.0
// What an endpoint receives by: rclcpp's subscription, with the chosen allocator.
#pragma once

#include <memory>

#include <ontime_msgs/msg/round_trip.hpp>
#include <rclcpp/callback_group.hpp>
#include <rclcpp/node.hpp>
#include <rclcpp/subscription_base.hpp>

#include "options.hpp"

namespace ontime::transport::ros2 {

// Where an executor brings a subscription's messages.
class Arrivals {
 public:
  virtual void on_message(const ontime_msgs::msg::RoundTrip& message) = 0;

 protected:
  ~Arrivals() = default;
};

// In that callback group; nullptr: in the node's own. `arrivals` must outlive it. May throw.
rclcpp::SubscriptionBase::SharedPtr new_subscription(const Config& config, const Options& options,
                                                     rclcpp::Node& node,
                                                     const rclcpp::CallbackGroup::SharedPtr& group,
                                                     Arrivals& arrivals);

}  // namespace ontime::transport::ros2

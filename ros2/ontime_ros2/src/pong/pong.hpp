// SPDX-License-Identifier: Apache-2.0
// The component's end as a node: it answers on `pong` what it hears on `ping`.
#pragma once

#include <ontime_msgs/msg/round_trip.hpp>
#include <rclcpp/rclcpp.hpp>

namespace ontime_ros2 {

class Pong : public rclcpp::Node {
 public:
  explicit Pong(const rclcpp::NodeOptions& options);

  // As they are after the user's remapping and namespace.
  const char* ping_topic() const { return subscription_->get_topic_name(); }
  const char* pong_topic() const { return publisher_->get_topic_name(); }

 private:
  using RoundTrip = ontime_msgs::msg::RoundTrip;

  void answer(const RoundTrip& ping);

  RoundTrip answer_;
  rclcpp::Publisher<RoundTrip>::SharedPtr publisher_;
  rclcpp::Subscription<RoundTrip>::SharedPtr subscription_;
};

}  // namespace ontime_ros2

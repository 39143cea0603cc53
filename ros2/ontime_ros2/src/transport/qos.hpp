// SPDX-License-Identifier: Apache-2.0
// What is asked of both topics, as rclcpp has it.
#pragma once

#include <cstddef>

#include <rclcpp/intra_process_setting.hpp>
#include <rclcpp/qos.hpp>

#include "options.hpp"

namespace ontime::transport::ros2 {

inline rclcpp::QoS vendor_qos(const Qos& qos) {
  rclcpp::QoS result(rclcpp::KeepLast(static_cast<std::size_t>(qos.depth)));
  if (qos.history == History::keep_all) result.keep_all();
  result.reliability(qos.reliability == Reliability::reliable ? rclcpp::ReliabilityPolicy::Reliable
                                                              : rclcpp::ReliabilityPolicy::BestEffort);
  result.durability(qos.durability == Durability::transient_local ? rclcpp::DurabilityPolicy::TransientLocal
                                                                  : rclcpp::DurabilityPolicy::Volatile);
  return result;
}

inline rclcpp::IntraProcessSetting vendor_intra_process(const Options& options) {
  return options.intra_process ? rclcpp::IntraProcessSetting::Enable : rclcpp::IntraProcessSetting::Disable;
}

}  // namespace ontime::transport::ros2

// SPDX-License-Identifier: Apache-2.0
// What a process gives its node beyond ROS 2: priorities for threads, and memory that stays.
#pragma once

#include <vector>

#include <rclcpp/rclcpp.hpp>
#include <sys/types.h>

namespace ontime_ros2 {

// As the node's parameters priority, background_priority and lock_memory say, for the calling thread, which
// will spin, and those that the middleware started with the node. Says what each thread then has, read back.
// Throws std::invalid_argument for what is no priority, std::runtime_error for what this machine refuses.
void make_realtime(rclcpp::Node& node, const std::vector<pid_t>& started);

}  // namespace ontime_ros2

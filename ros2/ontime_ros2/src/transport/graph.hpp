// SPDX-License-Identifier: Apache-2.0
// How many others read what we write and write what we read, known without asking. A thread sleeps until ROS
// 2 says that its graph changed, and asks the middleware only if that concerns our topics: to ask takes locks
// that sending and taking take as well.
#pragma once

#include <atomic>
#include <chrono>
#include <thread>
#include <utility>

#include <rcl/wait.h>
#include <rclcpp/rclcpp.hpp>

#include "transport/dds.hpp"
#include "transport/transport.hpp"

namespace ontime::transport::ros2 {

class Graph {
 public:
  static constexpr const char* thread_name = "ontime-graph";

  // All of these must outlive it.
  Graph(const rclcpp::Context::SharedPtr& context, rclcpp::Node& node, const rclcpp::PublisherBase& publisher,
        const rclcpp::SubscriptionBase& subscription);
  ~Graph();
  Graph(const Graph&) = delete;
  Graph& operator=(const Graph&) = delete;

  Matched matched() const noexcept { return matches_.now(); }  // any thread

 private:
  // Readers and writers of peers on our topics in the graph, whether or not they match.
  using Known = std::pair<std::size_t, std::size_t>;  // readers and writers

  void run() noexcept;
  void look();
  void wait(std::chrono::nanoseconds longest);
  Known known() const;

  rclcpp::Node& node_;
  const rclcpp::PublisherBase& publisher_;
  const rclcpp::SubscriptionBase& subscription_;
  rclcpp::GuardCondition ending_;
  rcl_wait_set_t wait_set_ = rcl_get_zero_initialized_wait_set();
  dds::Matches matches_;
  std::atomic<bool> ended_{false};
  std::thread thread_;
};

}  // namespace ontime::transport::ros2

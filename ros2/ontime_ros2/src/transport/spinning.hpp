// SPDX-License-Identifier: Apache-2.0
// rclcpp's executors, on threads of the transport.
#pragma once

#include <atomic>
#include <memory>
#include <thread>
#include <vector>

#include <rclcpp/callback_group.hpp>
#include <rclcpp/context.hpp>
#include <rclcpp/executor.hpp>
#include <rclcpp/node.hpp>

#include "options.hpp"

namespace ontime::transport::ros2 {

// Of the chosen kind, with memory of the chosen allocator. Throws Error where rclcpp has no such executor.
std::shared_ptr<rclcpp::Executor> new_executor(const Options& options,
                                               const rclcpp::Context::SharedPtr& context);

class Spinning {
 public:
  static constexpr const char* thread_name = "ontime-executor";
  static constexpr const char* name_beside = "beside-executor";  // where it runs background topics alone

  // The threads that it starts inherit the name.
  Spinning(std::shared_ptr<rclcpp::Executor> executor, const char* name);
  ~Spinning();
  Spinning(const Spinning&) = delete;
  Spinning& operator=(const Spinning&) = delete;

  const char* name() const { return name_; }
  // While it spins, too. What it was given it keeps, for it may be waiting on that.
  void add(const rclcpp::Node::SharedPtr& node);
  void add(const rclcpp::CallbackGroup::SharedPtr& group, const rclcpp::Node::SharedPtr& node);

 private:
  void spin() noexcept;

  std::vector<std::shared_ptr<void>> kept_;
  std::shared_ptr<rclcpp::Executor> executor_;
  const char* const name_;
  std::atomic<bool> named_{false};
  std::atomic<bool> ended_{false};
  std::thread thread_;
};

}  // namespace ontime::transport::ros2

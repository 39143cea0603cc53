// SPDX-License-Identifier: Apache-2.0
// rclcpp's executors, on threads of the transport.
#pragma once

#include <atomic>
#include <chrono>
#include <exception>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <pthread.h>
#include <rclcpp/rclcpp.hpp>
#if __has_include(<rclcpp/experimental/executors/events_executor/events_executor.hpp>)
#include <rclcpp/experimental/executors/events_executor/events_executor.hpp>
#define ONTIME_HAS_EVENTS_EXECUTOR
#endif

#include "environment.hpp"
#include "options.hpp"

namespace ontime::transport::ros2 {

inline std::shared_ptr<rclcpp::Executor> new_executor(Executor kind, const rclcpp::ExecutorOptions& options) {
  if (kind == Executor::single) return std::make_shared<rclcpp::executors::SingleThreadedExecutor>(options);
  if (kind == Executor::multi) return std::make_shared<rclcpp::executors::MultiThreadedExecutor>(options);
#ifdef ONTIME_HAS_EVENTS_EXECUTOR
  using Events = rclcpp::experimental::executors::EventsExecutor;
  return std::make_shared<Events>(std::make_unique<rclcpp::experimental::executors::SimpleEventsQueue>(),
                                  false, options);
#else
  throw Error("ros2: rclcpp has the events executor from ROS 2 Iron on, and this is " +
              environment("ROS_DISTRO") + "; choose executor single or multi");
#endif
}

class Spinning {
 public:
  static constexpr const char* thread_name = "ontime-executor";
  static constexpr const char* name_beside = "beside-executor";  // where it runs neighbours alone

  // The threads that it starts inherit the name.
  Spinning(std::shared_ptr<rclcpp::Executor> executor, const char* name)
      : executor_(std::move(executor)), name_(name) {
    thread_ = std::thread([this] {
      pthread_setname_np(pthread_self(), name_);
      named_ = true;
      named_.notify_one();
      spin();
      ended_ = true;
    });
    named_.wait(false);
  }
  ~Spinning() {
    // An executor forgets to have been cancelled before it began to spin.
    while (!ended_) {
      executor_->cancel();
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    thread_.join();
  }
  Spinning(const Spinning&) = delete;
  Spinning& operator=(const Spinning&) = delete;

  const char* name() const { return name_; }
  // While it spins, too. What it was given it keeps, for it may be waiting on that.
  void add(const rclcpp::Node::SharedPtr& node) {
    kept_.push_back(node);
    executor_->add_node(node);
  }
  void add(const rclcpp::CallbackGroup::SharedPtr& group, const rclcpp::Node::SharedPtr& node) {
    kept_.push_back(group);
    executor_->add_callback_group(group, node->get_node_base_interface());
  }

 private:
  void spin() noexcept {
    try {
      executor_->spin();
    } catch (const std::exception&) {
      // The middleware refuses to wait: nothing more arrives, and that is what the ledger then shows.
    }
  }

  std::vector<std::shared_ptr<void>> kept_;
  std::shared_ptr<rclcpp::Executor> executor_;
  const char* const name_;
  std::atomic<bool> named_{false};
  std::atomic<bool> ended_{false};
  std::thread thread_;
};

}  // namespace ontime::transport::ros2

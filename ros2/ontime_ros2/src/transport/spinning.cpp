// SPDX-License-Identifier: Apache-2.0
#include "spinning.hpp"

#include <chrono>
#include <exception>
#include <utility>

#include <pthread.h>
#include <rclcpp/executors.hpp>
#include <rclcpp/strategies/allocator_memory_strategy.hpp>
#if __has_include(<rclcpp/experimental/executors/events_executor/events_executor.hpp>)
#include <rclcpp/experimental/executors/events_executor/events_executor.hpp>
#define ONTIME_HAS_EVENTS_EXECUTOR
#endif

#include "allocator.hpp"
#include "environment.hpp"

namespace ontime::transport::ros2 {
namespace {

template <typename Alloc>
rclcpp::memory_strategy::MemoryStrategy::SharedPtr memory() {
  using rclcpp::memory_strategies::allocator_memory_strategy::AllocatorMemoryStrategy;
  return std::make_shared<AllocatorMemoryStrategy<Alloc>>(std::make_shared<Alloc>());
}

}  // namespace

std::shared_ptr<rclcpp::Executor> new_executor(const Options& options,
                                               const rclcpp::Context::SharedPtr& context) {
  rclcpp::ExecutorOptions executor_options;
  executor_options.context = context;
  executor_options.memory_strategy = options.allocator == Allocator::standard
                                         ? memory<std::allocator<void>>()
                                         : memory<ResourceAllocator<void>>();
  if (options.executor == Executor::single)
    return std::make_shared<rclcpp::executors::SingleThreadedExecutor>(executor_options);
  if (options.executor == Executor::multi)
    return std::make_shared<rclcpp::executors::MultiThreadedExecutor>(executor_options);
#ifdef ONTIME_HAS_EVENTS_EXECUTOR
  using Events = rclcpp::experimental::executors::EventsExecutor;
  return std::make_shared<Events>(std::make_unique<rclcpp::experimental::executors::SimpleEventsQueue>(),
                                  false, executor_options);
#else
  throw Error("ros2: rclcpp has the events executor from ROS 2 Iron on, and this is " +
              environment("ROS_DISTRO") + "; choose executor single or multi");
#endif
}

Spinning::Spinning(std::shared_ptr<rclcpp::Executor> executor, const char* name)
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

Spinning::~Spinning() {
  // An executor forgets to have been cancelled before it began to spin.
  while (!ended_) {
    executor_->cancel();
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  thread_.join();
}

void Spinning::add(const rclcpp::Node::SharedPtr& node) {
  kept_.push_back(node);
  executor_->add_node(node);
}

void Spinning::add(const rclcpp::CallbackGroup::SharedPtr& group, const rclcpp::Node::SharedPtr& node) {
  kept_.push_back(group);
  executor_->add_callback_group(group, node->get_node_base_interface());
}

void Spinning::spin() noexcept {
  try {
    executor_->spin();
  } catch (const std::exception&) {
    // The middleware refuses to wait: nothing more arrives, and that is what the ledger then shows.
  }
}

}  // namespace ontime::transport::ros2

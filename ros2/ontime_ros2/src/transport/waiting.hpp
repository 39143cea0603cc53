// SPDX-License-Identifier: Apache-2.0
// The two ways to wait for one subscription on a thread of the caller.
#pragma once

#include <memory>

#include <rclcpp/context.hpp>
#include <rclcpp/guard_condition.hpp>
#include <rclcpp/subscription_base.hpp>

#include "options.hpp"

namespace ontime::transport::ros2 {

class Waiting {
 public:
  virtual ~Waiting() = default;
  // Until there is something to take, or until interrupted. May throw.
  virtual void wait() = 0;
  void interrupt() { interrupted_->trigger(); }

 protected:
  explicit Waiting(const rclcpp::Context::SharedPtr& context)
      : interrupted_(std::make_shared<rclcpp::GuardCondition>(context)) {}
  rclcpp::GuardCondition::SharedPtr interrupted_;
};

std::unique_ptr<Waiting> new_waiting(Executor kind, const rclcpp::Context::SharedPtr& context,
                                     const rclcpp::SubscriptionBase::SharedPtr& subscription);

}  // namespace ontime::transport::ros2

// SPDX-License-Identifier: Apache-2.0
#include "waiting.hpp"

#include <utility>

#include <rcl/wait.h>
#include <rclcpp/wait_set.hpp>

namespace ontime::transport::ros2 {
namespace {

// rclcpp's, as an application has it that does without executors.
class WaitSet final : public Waiting {
 public:
  WaitSet(const rclcpp::Context::SharedPtr& context, const rclcpp::SubscriptionBase::SharedPtr& subscription)
      : Waiting(context), wait_set_({}, {}, {}, {}, {}, {}, context) {
    rclcpp::SubscriptionWaitSetMask messages_alone;
    messages_alone.include_events = false;
    messages_alone.include_intra_process_waitable = false;
    wait_set_.add_subscription(subscription, messages_alone);
    wait_set_.add_guard_condition(interrupted_);
  }
  void wait() override { static_cast<void>(wait_set_.wait().kind()); }

 private:
  rclcpp::WaitSet wait_set_;
};

// rcl's, with nothing of rclcpp around it: the least that ROS 2 can do.
class PlainWait final : public Waiting {
 public:
  PlainWait(const rclcpp::Context::SharedPtr& context, rclcpp::SubscriptionBase::SharedPtr subscription)
      : Waiting(context), subscription_(std::move(subscription)) {
    require(rcl_wait_set_init(&wait_set_, 1, 1, 0, 0, 0, 0, context->get_rcl_context().get(),
                              rcl_get_default_allocator()));
  }
  ~PlainWait() override {
    if (rcl_wait_set_fini(&wait_set_) != RCL_RET_OK) rcl_reset_error();
  }

  void wait() override {
    require(rcl_wait_set_clear(&wait_set_));
    require(
        rcl_wait_set_add_subscription(&wait_set_, subscription_->get_subscription_handle().get(), nullptr));
    require(rcl_wait_set_add_guard_condition(&wait_set_, &interrupted_->get_rcl_guard_condition(), nullptr));
    require(rcl_wait(&wait_set_, -1));
  }

 private:
  static void require(rcl_ret_t result) {
    if (result != RCL_RET_OK) rclcpp::exceptions::throw_from_rcl_error(result, "cannot wait");
  }

  rclcpp::SubscriptionBase::SharedPtr subscription_;
  rcl_wait_set_t wait_set_ = rcl_get_zero_initialized_wait_set();
};

}  // namespace

std::unique_ptr<Waiting> new_waiting(Executor kind, const rclcpp::Context::SharedPtr& context,
                                     const rclcpp::SubscriptionBase::SharedPtr& subscription) {
  if (kind == Executor::waitset) return std::make_unique<WaitSet>(context, subscription);
  return std::make_unique<PlainWait>(context, subscription);
}

}  // namespace ontime::transport::ros2

// SPDX-License-Identifier: Apache-2.0
#include "subscribing.hpp"

#include "allocator.hpp"
#include "qos.hpp"

namespace ontime::transport::ros2 {
namespace {

using ontime_msgs::msg::RoundTrip;

template <typename Alloc>
rclcpp::SubscriptionBase::SharedPtr subscription_with(const Config& config, const Options& options,
                                                      rclcpp::Node& node,
                                                      const rclcpp::CallbackGroup::SharedPtr& group,
                                                      Arrivals& arrivals) {
  const auto allocator = std::make_shared<Alloc>();
  rclcpp::SubscriptionOptionsWithAllocator<Alloc> subscription_options;
  subscription_options.allocator = allocator;
  subscription_options.use_default_callbacks = false;
  subscription_options.use_intra_process_comm = vendor_intra_process(options);
  subscription_options.callback_group = group;
  using Strategy = rclcpp::message_memory_strategy::MessageMemoryStrategy<RoundTrip, Alloc>;
  return node.create_subscription<RoundTrip>(
      config.role == Role::client ? config.pong_topic : config.ping_topic, vendor_qos(config.qos),
      [&arrivals](std::shared_ptr<const RoundTrip> message) { arrivals.on_message(*message); },
      subscription_options, std::make_shared<Strategy>(allocator));
}

}  // namespace

rclcpp::SubscriptionBase::SharedPtr new_subscription(const Config& config, const Options& options,
                                                     rclcpp::Node& node,
                                                     const rclcpp::CallbackGroup::SharedPtr& group,
                                                     Arrivals& arrivals) {
  if (options.allocator == Allocator::standard)
    return subscription_with<std::allocator<void>>(config, options, node, group, arrivals);
  return subscription_with<ResourceAllocator<void>>(config, options, node, group, arrivals);
}

}  // namespace ontime::transport::ros2

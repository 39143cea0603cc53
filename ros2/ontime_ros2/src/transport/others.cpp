// SPDX-License-Identifier: Apache-2.0
#include "others.hpp"

#include <algorithm>
#include <chrono>
#include <optional>
#include <thread>

#include <rcl/event.h>
#include <rmw/events_statuses/incompatible_qos.h>
#include <rmw/events_statuses/message_lost.h>

#include "transport/dds.hpp"

namespace ontime::transport::ros2 {
namespace {

// Cyclone DDS takes a few milliseconds, Fast DDS now and then more than a second.
constexpr auto namesakes_answer_within = std::chrono::milliseconds(1500);
constexpr const char* type = "ontime_msgs/msg/RoundTrip";

dds::Policy policy_of(rmw_qos_policy_kind_t kind) {
  if (kind == RMW_QOS_POLICY_RELIABILITY) return dds::Policy::reliability;
  if (kind == RMW_QOS_POLICY_DURABILITY) return dds::Policy::durability;
  return dds::Policy::other;
}

// Asked of rcl itself: rclcpp's way would wake the executor that is measured.
template <typename Status, typename Init>
std::optional<Status> status_of(const Init& init) {
  Status status{};
  rcl_event_t event = rcl_get_zero_initialized_event();
  const bool taken = init(&event) == RCL_RET_OK && rcl_take_event(&event, &status) == RCL_RET_OK;
  if (rcl_event_fini(&event) != RCL_RET_OK || !taken) rcl_reset_error();  // nothing to tell, then
  if (!taken) return {};
  return status;
}

template <typename Init>
rmw_qos_incompatible_event_status_t incompatible(const Init& init) {
  return status_of<rmw_qos_incompatible_event_status_t>(init).value_or(rmw_qos_incompatible_event_status_t{});
}

std::string refused(const Config& config, const rclcpp::PublisherBase& publisher,
                    const rclcpp::SubscriptionBase& subscription) {
  const auto requested = incompatible([&](rcl_event_t* event) {
    return rcl_subscription_event_init(event, subscription.get_subscription_handle().get(),
                                       RCL_SUBSCRIPTION_REQUESTED_INCOMPATIBLE_QOS);
  });
  if (requested.total_count > 0) return dds::refused_writer(config, policy_of(requested.last_policy_kind));
  const auto offered = incompatible([&](rcl_event_t* event) {
    return rcl_publisher_event_init(event, publisher.get_publisher_handle().get(),
                                    RCL_PUBLISHER_OFFERED_INCOMPATIBLE_QOS);
  });
  if (offered.total_count > 0) return dds::refused_reader(config, policy_of(offered.last_policy_kind));
  return {};
}

std::string other_types(const rclcpp::Node& node, const std::string& topic) {
  const auto topics = node.get_topic_names_and_types();
  const auto found = topics.find(topic);
  if (found == topics.end()) return {};
  const auto other = std::find_if(found->second.begin(), found->second.end(),
                                  [](const std::string& name) { return name != type; });
  if (other == found->second.end()) return {};
  return "another program has " + topic + " with type " + *other + ", ontime has " + type +
         ". Fix: build both ends with the same ontime_msgs";
}

}  // namespace

void refuse_namesake(const rclcpp::Node& node) {
  const std::string name = node.get_fully_qualified_name();
  const auto end = std::chrono::steady_clock::now() + namesakes_answer_within;
  while (std::chrono::steady_clock::now() < end) {
    const auto names = node.get_node_names();
    if (std::count(names.begin(), names.end(), name) > 1)
      throw Error("ros2: node " + name +
                  " already exists. Fix: end it, or use another name (--option node=NAME) or namespace");
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
}

Losses losses_of(const std::string& rmw, const rclcpp::SubscriptionBase& subscription) {
  // Fast DDS counts gaps in what reaches the reader. Cyclone DDS has the status and counts there only what a
  // reader rejects, and other RMWs do not say what theirs means.
  if (!rmw.starts_with("rmw_fastrtps")) return {};
  const auto lost = status_of<rmw_message_lost_status_t>([&](rcl_event_t* event) {
    return rcl_subscription_event_init(event, subscription.get_subscription_handle().get(),
                                       RCL_SUBSCRIPTION_MESSAGE_LOST);
  });
  if (!lost) return {};
  return {.on_the_way = lost->total_count, .overwritten = {}};
}

std::string seen(const Config& config, rclcpp::Node& node, const rclcpp::PublisherBase& publisher,
                 const rclcpp::SubscriptionBase& subscription, Matched matched) {
  if (std::string text = refused(config, publisher, subscription); !text.empty()) return text;
  for (const std::string topic : {publisher.get_topic_name(), subscription.get_topic_name()})
    if (std::string text = other_types(node, topic); !text.empty()) return text;
  std::string others;
  for (const std::string& name : node.get_node_names())
    if (name != node.get_fully_qualified_name()) others += (others.empty() ? "" : ", ") + name;
  if (matched.both()) return {};
  if (others.empty()) return dds::others_elsewhere(config);
  std::string text = "other nodes in domain " + std::to_string(config.domain) + ": " + others;
  if (matched.readers == 0) text += std::string("; no reader of ") + publisher.get_topic_name();
  if (matched.writers == 0) text += std::string("; no writer of ") + subscription.get_topic_name();
  return text;
}

}  // namespace ontime::transport::ros2

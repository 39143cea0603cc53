// SPDX-License-Identifier: Apache-2.0
#include "pong.hpp"

#include <cstdint>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>

#include <rclcpp_components/register_node_macro.hpp>

#include "message/message.hpp"
#include "transport/clock.hpp"

namespace ontime_ros2 {
namespace {

using ontime::transport::now_ns;

template <typename Value>
Value parameter(rclcpp::Node& node, const char* name, const Value& otherwise, const char* description) {
  rcl_interfaces::msg::ParameterDescriptor descriptor;
  descriptor.description = description;
  descriptor.read_only = true;
  return node.declare_parameter(name, otherwise, descriptor);
}

bool is_first_of(const char* name, const std::string& value, const char* first, const char* second) {
  if (value == first || value == second) return value == first;
  throw std::invalid_argument("parameter " + std::string(name) + ": '" + value + "' is not one of " + first +
                              ", " + second);
}

std::size_t at_least(const char* name, std::int64_t value, std::int64_t least) {
  if (value >= least) return static_cast<std::size_t>(value);
  throw std::invalid_argument("parameter " + std::string(name) + ": " + std::to_string(value) +
                              " is less than " + std::to_string(least));
}

rclcpp::QoS qos(rclcpp::Node& node) {
  const auto depth = at_least(
      "depth", parameter<std::int64_t>(node, "depth", 1, "messages that history keep-last keeps"), 1);
  rclcpp::QoS qos{rclcpp::KeepLast(depth)};
  if (is_first_of("history", parameter<std::string>(node, "history", "keep-last", "keep-last or keep-all"),
                  "keep-all", "keep-last"))
    qos.keep_all();
  if (is_first_of("reliability",
                  parameter<std::string>(node, "reliability", "best-effort", "best-effort or reliable"),
                  "reliable", "best-effort"))
    qos.reliable();
  else
    qos.best_effort();
  return qos;
}

}  // namespace

Pong::Pong(const rclcpp::NodeOptions& options) : Node("ontime_pong", options) {
  answer_.data.reserve(at_least(
      "payload",
      parameter<std::int64_t>(*this, "payload", 65536, "bytes that are answered without allocating"), 0));
  const auto both = qos(*this);
  publisher_ = create_publisher<RoundTrip>("pong", both);
  subscription_ = create_subscription<RoundTrip>(
      "ping", both, [this](std::shared_ptr<const RoundTrip> ping) { answer(*ping); });
}

void Pong::answer(const RoundTrip& ping) {
  const std::int64_t received_ns = now_ns();
  answer_.seq = ping.seq;
  answer_.data.assign(ping.data.begin(), ping.data.end());
  ontime::message::put_server_times(std::as_writable_bytes(std::span(answer_.data)), {received_ns, now_ns()});
  publisher_->publish(answer_);
}

}  // namespace ontime_ros2

RCLCPP_COMPONENTS_REGISTER_NODE(ontime_ros2::Pong)

// SPDX-License-Identifier: Apache-2.0
// What an endpoint sends by: rclcpp's publisher, with the chosen allocator.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include <rclcpp/node.hpp>
#include <rclcpp/publisher_base.hpp>

#include "options.hpp"

namespace ontime::transport::ros2 {

class Publishing {
 public:
  virtual ~Publishing() = default;
  // One at a time. May throw.
  virtual void publish(std::uint64_t sequence, std::span<const std::byte> payload) = 0;
  virtual const rclcpp::PublisherBase& publisher() const = 0;
};

// May throw.
std::unique_ptr<Publishing> new_publishing(const Config& config, const Options& options, rclcpp::Node& node);

}  // namespace ontime::transport::ros2

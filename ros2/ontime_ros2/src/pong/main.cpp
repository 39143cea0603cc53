// SPDX-License-Identifier: Apache-2.0
// ros2 run ontime_ros2 pong
#include <exception>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "pong.hpp"
#include "realtime.hpp"
#include "transport/dds.hpp"

namespace {

// ROS 2 ignores a parameter that no node declares: a misspelt one would change nothing. It may be for another
// node, from a file that all nodes get.
void warn_of_unknown_parameters(rclcpp::Node& node) {
  for (const auto& [name, value] : node.get_node_parameters_interface()->get_parameter_overrides()) {
    if (node.has_parameter(name)) continue;
    std::string known;
    for (const auto& one : node.list_parameters({}, 1).names) known += (known.empty() ? "" : ", ") + one;
    RCLCPP_WARN(node.get_logger(), "unknown parameter '%s' has no effect; known: %s", name.c_str(),
                known.c_str());
  }
}

std::shared_ptr<ontime_ros2::Pong> new_pong() {
  const auto before = ontime::transport::dds::tasks();
  auto node = std::make_shared<ontime_ros2::Pong>(rclcpp::NodeOptions());
  std::vector<pid_t> started;
  for (const auto& task : ontime::transport::dds::started_since(before)) started.push_back(task.tid);
  ontime_ros2::make_realtime(*node, started);
  warn_of_unknown_parameters(*node);
  return node;
}

int run() {
  const auto node = new_pong();
  RCLCPP_INFO(node->get_logger(), "answers %s on %s in domain %zu", node->ping_topic(), node->pong_topic(),
              node->get_node_base_interface()->get_context()->get_domain_id());
  rclcpp::executors::SingleThreadedExecutor executor;
  executor.add_node(node);
  executor.spin();
  return 0;
}

int failed(int code, const std::exception& error) {
  RCLCPP_ERROR(rclcpp::get_logger("ontime_pong"), "%s", error.what());
  return code;
}

}  // namespace

// Exit codes as ontime's: 2 wrong input, 3 this machine cannot.
int main(int argc, char** argv) {
  int status = 0;
  try {
    rclcpp::init(argc, argv);
    status = run();
  } catch (const std::invalid_argument& error) {
    status = failed(2, error);
  } catch (const rclcpp::exceptions::InvalidParameterTypeException& error) {
    status = failed(2, error);
  } catch (const std::exception& error) {
    status = failed(3, error);
  }
  rclcpp::shutdown();
  return status;
}

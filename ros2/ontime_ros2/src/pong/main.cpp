// SPDX-License-Identifier: Apache-2.0
// ros2 run ontime_ros2 pong
#include <cerrno>
#include <exception>
#include <memory>
#include <system_error>

#include <sched.h>
#include <sys/mman.h>

#include "pong.hpp"

namespace {

void require(bool done, const std::string& what, const std::string& remedy) {
  if (done) return;
  throw std::runtime_error("cannot " + what + ": " + std::system_category().message(errno) + "; " + remedy);
}

// The thread is this process's and not the node's, and so are these two parameters.
void make_realtime(rclcpp::Node& node) {
  if (node.declare_parameter("lock_memory", false))
    require(mlockall(MCL_CURRENT | MCL_FUTURE) == 0, "lock memory",
            "raise the limit memlock or grant CAP_IPC_LOCK");
  const auto priority = static_cast<int>(node.declare_parameter("priority", 0));
  if (priority == 0) return;
  const sched_param wanted{.sched_priority = priority};
  require(sched_setscheduler(0, SCHED_FIFO, &wanted) == 0,
          "give the executor the real-time priority " + std::to_string(priority),
          "choose 1 to 99, and raise the limit rtprio or grant CAP_SYS_NICE");
}

}  // namespace

int main(int argc, char** argv) {
  rclcpp::init(argc, argv);
  try {
    const auto node = std::make_shared<ontime_ros2::Pong>(rclcpp::NodeOptions());
    make_realtime(*node);
    RCLCPP_INFO(node->get_logger(), "answers %s on %s",
                node->get_node_topics_interface()->resolve_topic_name("ping").c_str(),
                node->get_node_topics_interface()->resolve_topic_name("pong").c_str());
    rclcpp::executors::SingleThreadedExecutor executor;
    executor.add_node(node);
    executor.spin();
  } catch (const std::exception& error) {
    RCLCPP_ERROR(rclcpp::get_logger("ontime_pong"), "%s", error.what());
    rclcpp::shutdown();
    return 1;
  }
  rclcpp::shutdown();
  return 0;
}

// SPDX-License-Identifier: Apache-2.0
#include "graph.hpp"

#include <exception>

#include <pthread.h>
#include <rcl/graph.h>

#include "transport/clock.hpp"

namespace ontime::transport::ros2 {
namespace {

using std::chrono::nanoseconds;

// An end shows in the graph shortly before the middleware has matched it, or after: so we look again, ever
// more seldom, until about a second after a change.
constexpr nanoseconds first_pause = std::chrono::milliseconds(1);
constexpr nanoseconds last_pause = std::chrono::milliseconds(512);
constexpr nanoseconds until_a_change{-1};

void require(rcl_ret_t result) {
  if (result != RCL_RET_OK) rclcpp::exceptions::throw_from_rcl_error(result, "cannot follow the graph");
}

}  // namespace

Graph::Graph(const rclcpp::Context::SharedPtr& context, rclcpp::Node& node,
             const rclcpp::PublisherBase& publisher, const rclcpp::SubscriptionBase& subscription)
    : node_(node), publisher_(publisher), subscription_(subscription), ending_(context) {
  require(rcl_wait_set_init(&wait_set_, 0, 2, 0, 0, 0, 0, context->get_rcl_context().get(),
                            rcl_get_default_allocator()));
  thread_ = std::thread([this] { run(); });
  pthread_setname_np(thread_.native_handle(), thread_name);  // here, because threads() finds it by its name
}

Graph::~Graph() {
  ended_ = true;
  try {
    ending_.trigger();
  } catch (const std::exception&) {
    // Only an invalid guard condition throws, and ours lives as long as we.
  }
  thread_.join();
  if (rcl_wait_set_fini(&wait_set_) != RCL_RET_OK) rcl_reset_error();
}

void Graph::run() noexcept {
  try {
    Known before = known();
    nanoseconds pause = first_pause;
    std::int64_t next_look_ns = now_ns();
    while (!ended_) {
      const nanoseconds rest{next_look_ns - now_ns()};
      if (pause <= last_pause && rest.count() <= 0) {
        look();
        next_look_ns = now_ns() + pause.count();
        pause *= 2;
        continue;
      }
      wait(pause <= last_pause ? rest : until_a_change);
      if (const Known now = known(); now != before) {
        before = now;
        pause = first_pause;
        next_look_ns = now_ns();
      }
    }
  } catch (const std::exception&) {
    // The middleware refuses to tell: what was known last stays.
  }
}

void Graph::look() {
  matches_.set_readers(static_cast<int>(publisher_.get_subscription_count()));
  matches_.set_writers(static_cast<int>(subscription_.get_publisher_count()));
}

// For a change of the graph, for the end, or at the longest so long.
void Graph::wait(nanoseconds longest) {
  const rcl_node_t* const node = node_.get_node_base_interface()->get_rcl_node_handle();
  require(rcl_wait_set_clear(&wait_set_));
  require(rcl_wait_set_add_guard_condition(&wait_set_, rcl_node_get_graph_guard_condition(node), nullptr));
  require(rcl_wait_set_add_guard_condition(&wait_set_, &ending_.get_rcl_guard_condition(), nullptr));
  const rcl_ret_t result = rcl_wait(&wait_set_, longest.count());
  if (result != RCL_RET_TIMEOUT) require(result);
}

Graph::Known Graph::known() const {
  return {node_.count_subscribers(publisher_.get_topic_name()),
          node_.count_publishers(subscription_.get_topic_name())};
}

}  // namespace ontime::transport::ros2

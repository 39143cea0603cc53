// SPDX-License-Identifier: Apache-2.0
#include "realtime.hpp"

#include <cerrno>
#include <stdexcept>
#include <string>
#include <system_error>

#include <rmw/rmw.h>
#include <sched.h>
#include <sys/mman.h>
#include <unistd.h>

#include "transport/threads.hpp"

namespace ontime_ros2 {
namespace {

using ontime::transport::Thread;

void require(bool done, const std::string& what, const std::string& remedy) {
  if (done) return;
  throw std::runtime_error("cannot " + what + ": " + std::system_category().message(errno) +
                           ". Fix: " + remedy);
}

int priority_of(rclcpp::Node& node, const char* name) {
  const auto priority = node.declare_parameter<std::int64_t>(name, 0);
  if (priority < 0 || priority > 99)
    throw std::invalid_argument("parameter " + std::string(name) + ": " + std::to_string(priority) +
                                " is not a priority: 1 to 99 for SCHED_FIFO, 0 for an ordinary thread");
  return static_cast<int>(priority);
}

// Threads of unknown role get no priority: they may not be background threads. A resend thread never gets one
// (transport.hpp).
bool may_have_priority(const Thread& thread) { return thread.role != "unknown" && thread.role != "resend"; }

bool is_passed_through(const Thread& thread) {
  return thread.role == "send" || thread.role == "receive" || thread.role == "delivery";
}

std::string text_of(const Thread& thread) {
  return "thread " + std::to_string(thread.tid) + ", " + thread.name + " (" + thread.role + ")";
}

void set_priority(const Thread& thread, int priority) {
  const sched_param wanted{.sched_priority = priority};
  require(
      sched_setscheduler(thread.tid, SCHED_FIFO, &wanted) == 0,
      "give SCHED_FIFO " + std::to_string(priority) + " to " + text_of(thread),
      "raise the limit rtprio (/etc/security/limits.conf; in a service LimitRTPRIO) or grant CAP_SYS_NICE");
}

std::string scheduling_of(const Thread& thread) {
  sched_param now{};
  const int policy = sched_getscheduler(thread.tid);
  if (policy < 0 || sched_getparam(thread.tid, &now) != 0) return "ended";
  if (policy == SCHED_FIFO) return "SCHED_FIFO " + std::to_string(now.sched_priority);
  if (policy == SCHED_RR) return "SCHED_RR " + std::to_string(now.sched_priority);
  return policy == SCHED_OTHER ? "SCHED_OTHER" : "policy " + std::to_string(policy);
}

std::vector<Thread> threads(rclcpp::Node& node, const std::vector<pid_t>& started) {
  const auto context = node.get_node_base_interface()->get_context();
  auto found = ontime::transport::ros2::threads_of(rmw_get_implementation_identifier(), started,
                                                   static_cast<int>(context->get_domain_id()));
  found.insert(found.begin(), {gettid(), "receive", "executor"});
  return found;
}

}  // namespace

void make_realtime(rclcpp::Node& node, const std::vector<pid_t>& started) {
  if (node.declare_parameter("lock_memory", false))
    require(mlockall(MCL_CURRENT | MCL_FUTURE) == 0, "lock memory",
            "raise the limit memlock or grant CAP_IPC_LOCK");
  const int priority = priority_of(node, "priority");
  const int background_priority = priority_of(node, "background_priority");
  if (priority == 0 && background_priority == 0) return;
  for (const Thread& thread : threads(node, started)) {
    const int wanted = is_passed_through(thread) ? priority : background_priority;
    if (wanted != 0 && may_have_priority(thread)) set_priority(thread, wanted);
    RCLCPP_INFO(node.get_logger(), "%s: %s", text_of(thread).c_str(), scheduling_of(thread).c_str());
  }
}

}  // namespace ontime_ros2

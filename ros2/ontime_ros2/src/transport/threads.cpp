// SPDX-License-Identifier: Apache-2.0
#include "threads.hpp"

#include <algorithm>
#include <fstream>

#include "transport/cyclonedds/configuration.hpp"
#include "transport/fastdds/threads.hpp"

namespace ontime::transport::ros2 {
namespace {

std::string name_of(pid_t tid) {
  std::string name;
  std::getline(std::ifstream("/proc/self/task/" + std::to_string(tid) + "/comm"), name);
  return name;
}

// The RMWs start a thread of their own, the last with a node, which follows who is in the graph.
Thread graph_thread(pid_t tid) { return {tid, "discovery", name_of(tid)}; }

}  // namespace

std::vector<Thread> named(const std::string& name, const std::string& role) {
  std::vector<Thread> found;
  for (const pid_t tid : fastdds::tasks())
    if (name_of(tid) == name) found.push_back({tid, role, name});
  return found;
}

std::vector<Thread> threads_of(const std::string& rmw, const std::vector<pid_t>& created, int domain) {
  if (created.empty()) return {};
  std::vector<Thread> found;
  if (rmw.starts_with("rmw_fastrtps")) {
    found = fastdds::tell_apart({created.begin(), created.end() - 1}, domain);
    found.push_back(graph_thread(created.back()));
    return found;
  }
  for (const pid_t tid : fastdds::tasks())
    if (const auto* const thread = cyclonedds::named_thread(name_of(tid)))
      found.push_back({tid, thread->role, thread->name});
    else if (std::find(created.begin(), created.end(), tid) != created.end())
      found.push_back(graph_thread(tid));
  return found;
}

}  // namespace ontime::transport::ros2

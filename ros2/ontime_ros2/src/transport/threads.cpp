// SPDX-License-Identifier: Apache-2.0
#include "threads.hpp"

#include <algorithm>
#include <chrono>
#include <thread>

#include "environment.hpp"
#include "transport/clock.hpp"
#include "transport/cyclonedds/configuration.hpp"
#include "transport/dds.hpp"
#include "transport/fastdds/threads.hpp"

namespace ontime::transport::ros2 {
namespace {

// The RMWs start a thread of their own, the last with a node, which follows who is in the graph.
Thread graph_thread(const dds::Task& task) { return {task.tid, "discovery", task.name}; }

// A thread is born with its parent's name, and gives itself its own a little later; the RMW's keeps it.
void await_names(const std::vector<pid_t>& created) {
  const auto is_named = [](const dds::Task& task) { return cyclonedds::named_thread(task.name) != nullptr; };
  const std::int64_t until_ns = now_ns() + 20'000'000;
  do {
    const auto tasks = dds::tasks();
    const auto named = std::count_if(tasks.begin(), tasks.end(), is_named);
    if (named + 1 >= static_cast<std::ptrdiff_t>(created.size())) return;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  } while (now_ns() < until_ns);
}

// Then the thread for retransmissions sends everything. It still gets no priority, because it spins for
// locks.
bool sends_asynchronously() { return environment("RMW_FASTRTPS_PUBLICATION_MODE") == "ASYNCHRONOUS"; }

std::vector<Thread> of_fastdds(const std::vector<pid_t>& created, int domain) {
  auto found = fastdds::tell_apart({created.begin(), created.end() - 1}, domain);
  if (sends_asynchronously())
    for (auto& thread : found)
      if (thread.role == "resend") thread.name += " (sends all: ASYNCHRONOUS)";
  for (const auto& task : dds::tasks())
    if (task.tid == created.back()) found.push_back(graph_thread(task));
  return found;
}

}  // namespace

std::vector<Thread> named(const std::string& name, const std::string& role) {
  std::vector<Thread> found;
  for (const auto& task : dds::tasks())
    if (task.name == name) found.push_back({task.tid, role, name});
  return found;
}

std::vector<Thread> threads_of(const std::string& rmw, const std::vector<pid_t>& created, int domain) {
  if (created.empty()) return {};
  if (rmw.starts_with("rmw_fastrtps")) return of_fastdds(created, domain);
  await_names(created);
  std::vector<Thread> found;
  for (const auto& task : dds::tasks())
    if (const auto* const thread = cyclonedds::named_thread(task.name))
      found.push_back({task.tid, thread->role, thread->name});
    else if (std::find(created.begin(), created.end(), task.tid) != created.end())
      found.push_back(graph_thread(task));
  return found;
}

}  // namespace ontime::transport::ros2

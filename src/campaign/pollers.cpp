// SPDX-License-Identifier: Apache-2.0
#include "campaign/pollers.hpp"

#include <algorithm>
#include <map>
#include <set>

#include <fmt/format.h>

#include "agent/agent.hpp"
#include "campaign/pair.hpp"

namespace ontime::campaign {
namespace {

// The thread that polls, if it does so at a priority above every ordinary thread.
const realtime::ThreadSettings* poller_of(const agent::Task& task) {
  const auto option = task.config.options.find("busy-poll");
  if (option == task.config.options.end() || option->second != "on") return nullptr;
  const auto thread = task.realtime.threads.find("receive");
  if (thread == task.realtime.threads.end()) return nullptr;
  const auto policy = thread->second.policy;
  const bool is_above_all = policy == realtime::Policy::fifo || policy == realtime::Policy::round_robin;
  return is_above_all ? &thread->second : nullptr;
}

}  // namespace

bool is_throttled(const record::Machine& machine, const settings::Wishes& kernel) {
  if (const auto wish = kernel.find("rt-throttling"); wish != kernel.end()) return wish->second != "off";
  const auto runtime = machine.rt_runtime_us.value_or(-1);
  return runtime >= 0 && runtime < machine.rt_period_us.value_or(0);
}

std::string why_refused(std::optional<std::int64_t> cpus, bool throttled,
                        const std::vector<std::vector<int>>& cpus_of_threads) {
  if (throttled || !cpus) return "";
  std::set<int> taken;
  std::size_t pinned = 0, on_any = 0;
  for (const auto& own : cpus_of_threads)
    if (own.empty()) {
      ++on_any;
    } else {
      ++pinned;
      taken.insert(own.begin(), own.end());
    }
  // A thread takes one CPU at a time, however many it may use.
  if (std::min(taken.size(), pinned) + on_any < static_cast<std::size_t>(*cpus)) return "";
  return fmt::format(
      "busy-poll: {} real-time threads never sleep, on {} CPUs, without real-time throttling. Nothing else "
      "could run. Fix: leave a CPU free (realtime.receive.cpus), poll at one end, or set "
      "kernel.rt-throttling: on",
      cpus_of_threads.size(), *cpus);
}

void check_pollers(const Together& runs, const Machines& machines) {
  struct Polled {
    const record::Machine& machine;
    std::string host;
    std::vector<std::vector<int>> cpus{};
  };
  std::map<std::string, Polled> by_boot;
  const auto look = [&](const agent::Task& task, const std::string& host) {
    const auto* const thread = poller_of(task);
    if (thread == nullptr) return;
    const auto& machine = machines.machine(host);
    by_boot.try_emplace(machine.boot_id.empty() ? host : machine.boot_id, Polled{machine, host})
        .first->second.cpus.push_back(thread->cpus);
  };
  const auto& run = runs.front();
  if (!run.isolation.cpus.empty()) return;  // the ends have CPUs of their own, and all else has the others
  look(run.task, "controller");
  if (machines.hosts().kind != Hosts::Kind::alone)
    for (const auto& one : runs) look(server_task(one, {}), one.component);
  for (const auto& [boot, polled] : by_boot)
    if (const auto why =
            why_refused(polled.machine.cpu_count, is_throttled(polled.machine, run.kernel), polled.cpus);
        !why.empty())
      throw Error(2, fmt::format("on the {}, {}", polled.host, why));
}

}  // namespace ontime::campaign

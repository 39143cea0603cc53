// SPDX-License-Identifier: Apache-2.0
#include <cerrno>
#include <filesystem>
#include <system_error>
#include <thread>

#include <fmt/format.h>
#include <linux/capability.h>
#include <sched.h>
#include <sys/resource.h>
#include <unistd.h>

#include "realtime/privileges.hpp"
#include "realtime/realtime.hpp"
#include "realtime/state.hpp"

namespace ontime::realtime {
namespace {

constexpr const char* online_cpus = "/sys/devices/system/cpu/online";

std::string cpus_now(pid_t tid) {
  const auto state = read(tid);
  return state ? state->cpus : "none";
}

std::string value_in(const std::string& path) { return process::word(process::text_of(path)).value_or(""); }

std::string asked_policy(const std::string& who, const ThreadSettings& settings) {
  if (settings.policy == Policy::other) return fmt::format("SCHED_OTHER for thread {}", who);
  if (settings.policy == Policy::deadline)
    return fmt::format("SCHED_DEADLINE (runtime {} ns, deadline {} ns, period {} ns) for thread {}",
                       settings.runtime.count(), settings.deadline.count(), settings.period.count(), who);
  return fmt::format("SCHED_{} {} for thread {}", settings.policy == Policy::fifo ? "FIFO" : "RR",
                     settings.priority, who);
}

Attributes attributes_for(const ThreadSettings& settings, const Attributes& now) {
  // Niceness and flags stay: an ordinary user may not lower the one nor clear the other.
  Attributes wanted = now;
  wanted.size = sizeof wanted;
  wanted.policy = settings.policy;
  wanted.priority = static_cast<std::uint32_t>(settings.priority);
  wanted.runtime_ns = static_cast<std::uint64_t>(settings.runtime.count());
  wanted.deadline_ns = static_cast<std::uint64_t>(settings.deadline.count());
  wanted.period_ns = static_cast<std::uint64_t>(settings.period.count());
  return wanted;
}

using Explanation = std::pair<std::string, std::string>;  // what was found, and the remedy

Explanation explain_no_permission(pid_t tid, const ThreadSettings& settings) {
  const bool deadline = settings.policy == Policy::deadline;
  const auto budget = deadline ? "" : file_of_empty_realtime_budget();
  if (!budget.empty())
    return {fmt::format("{} is 0", budget),
            fmt::format(
                "give this control group real-time CPU time (its parents first): echo 900000 | sudo tee {}",
                budget)};
  if (const auto own = privileges(); !own.has(CAP_SYS_NICE)) {
    const auto lack = own.lack_of("CAP_SYS_NICE");
    if (deadline) return {lack, how_to_permit_capabilities()};
    return {fmt::format("RLIMIT_RTPRIO is {}, {}", limit_of(RLIMIT_RTPRIO), lack),
            how_to_permit(settings.priority)};
  }
  if (deadline)
    return {fmt::format("its CPUs are {} of {}", cpus_now(tid), value_in(online_cpus)),
            "SCHED_DEADLINE needs all CPUs: do not set the thread's CPUs (also not with taskset), or use an "
            "exclusive cpuset (sched(7))"};
  return {"although the process has CAP_SYS_NICE",
          "a container or service may filter system calls: docker run --cap-add=sys_nice --ulimit rtprio=99, "
          "systemd: RestrictRealtime=no"};
}

Explanation explain(int error, pid_t tid, const ThreadSettings& settings) {
  if (error == EPERM) return explain_no_permission(tid, settings);
  if (error == EINVAL)
    return {"invalid combination of values",
            "priority 1 … 99 for fifo and rr, 0 for the others; for deadline 1024 ns ≤ runtime ≤ deadline ≤ "
            "period, and a period within /proc/sys/kernel/sched_deadline_period_{min,max}_us"};
  if (error == EBUSY)
    return {fmt::format("all deadline threads together may use {} of every {} µs on each CPU",
                        value_in("/proc/sys/kernel/sched_rt_runtime_us"),
                        value_in("/proc/sys/kernel/sched_rt_period_us")),
            "set a smaller runtime or a longer period, or use fewer deadline threads"};
  return {"", "see sched_setattr(2)"};
}

std::optional<Refusal> set_affinity(pid_t tid, const std::string& who, const std::vector<int>& cpus) {
  cpu_set_t wanted, before;
  CPU_ZERO(&wanted);
  for (const int cpu : cpus)
    if (cpu >= 0) CPU_SET(static_cast<unsigned>(cpu), &wanted);
  const bool known = sched_getaffinity(tid, sizeof before, &before) == 0;
  const int error = sched_setaffinity(tid, sizeof wanted, &wanted) == 0 ? 0 : errno;
  const auto got = cpus_now(tid);
  if (error == 0 && got == list_of(cpus)) return {};
  // The kernel ignores CPUs that do not exist and sets the rest: part of a request is not the request.
  if (error == 0 && known) sched_setaffinity(tid, sizeof before, &before);
  return Refusal{fmt::format("CPUs {} for thread {}", list_of(cpus), who),
                 error == 0 ? fmt::format("only CPUs {} granted", got) : message_of(error),
                 fmt::format("set CPUs among {} ({}) that its cpuset control group also allows",
                             value_in(online_cpus), online_cpus)};
}

std::optional<Refusal> set_policy(pid_t tid, const std::string& who, const ThreadSettings& settings,
                                  const Attributes& now) {
  const int error = set_attributes(tid, attributes_for(settings, now));
  if (error == 0) return {};
  const auto [found, remedy] = explain(error, tid, settings);
  return Refusal{asked_policy(who, settings),
                 found.empty() ? message_of(error) : fmt::format("{} ({})", message_of(error), found),
                 remedy};
}

}  // namespace

std::vector<Refusal> apply(pid_t tid, const std::string& who, const ThreadSettings& settings) {
  std::error_code ignored;
  const bool ours = std::filesystem::exists(fmt::format("/proc/self/task/{}", tid), ignored);
  const auto now = ours ? attributes_of(tid) : std::nullopt;
  if (!now)
    return {{fmt::format("settings for thread {}", who), fmt::format("this process has no thread {}", tid),
             "request them while the thread runs"}};
  std::vector<Refusal> refusals;
  if (!settings.cpus.empty()) {
    // The kernel lets no deadline thread be tied to some CPUs.
    if (now->policy == Policy::deadline) set_attributes(tid, attributes_for({}, *now));
    if (auto refusal = set_affinity(tid, who, settings.cpus)) refusals.push_back(std::move(*refusal));
  }
  if (auto refusal = set_policy(tid, who, settings, *now)) refusals.push_back(std::move(*refusal));
  return refusals;
}

bool may_use_fifo(int priority) {
  bool may = false;
  try {
    std::thread([&] {
      may =
          set_attributes(gettid(),
                         attributes_for({.policy = Policy::fifo, .priority = priority, .cpus = {}}, {})) == 0;
    }).join();
  } catch (const std::system_error&) {
    return false;  // not even an ordinary thread can be started
  }
  return may;
}

}  // namespace ontime::realtime

// SPDX-License-Identifier: Apache-2.0
#include "realtime/state.hpp"

#include <fmt/format.h>
#include <linux/perf_event.h>

#include "number.hpp"

namespace ontime::realtime {
namespace {

std::uint64_t number_of(const std::optional<std::string>& text) {
  return number_in<std::uint64_t>(text.value_or("")).value_or(0);
}

// SCHED_BATCH and SCHED_IDLE are ordinary, too.
Policy known_policy(Policy policy) {
  for (const auto real_time : {Policy::fifo, Policy::round_robin, Policy::deadline})
    if (policy == real_time) return policy;
  return Policy::other;
}

// The scheduler's own account, to the nanosecond, where /proc has ticks of 10 ms. The number is how the
// kernel names any thread's CPU clock (clock_getcpuclockid(3) knows processes only).
std::chrono::nanoseconds cpu_time_of(pid_t tid) {
  constexpr clockid_t per_thread = 4, scheduler = 2;
  timespec time{};
  if (clock_gettime((~static_cast<clockid_t>(tid) << 3) | per_thread | scheduler, &time) != 0) return {};
  return std::chrono::seconds(time.tv_sec) + std::chrono::nanoseconds(time.tv_nsec);
}

}  // namespace

std::optional<ThreadState> read(pid_t tid) {
  const auto folder = fmt::format("/proc/self/task/{}/", tid);
  ThreadState state;
  state.tid = tid;
  const auto attributes = attributes_of(tid);
  const auto status = process::text_of(folder + "status").value_or("");
  const auto cpus = process::field(status, "Cpus_allowed_list");
  const auto stat = process::parse_stat(process::text_of(folder + "stat").value_or(""));
  if (!attributes || !cpus || !stat) return {};
  state.minor_faults = stat->minor_faults;
  state.major_faults = stat->major_faults;
  state.policy = known_policy(attributes->policy);
  state.priority = static_cast<int>(attributes->priority);
  state.cpus = *cpus;
  state.cpu_time = cpu_time_of(tid);
  state.voluntary_switches = number_of(process::field(status, "voluntary_ctxt_switches"));
  state.involuntary_switches = number_of(process::field(status, "nonvoluntary_ctxt_switches"));
  state.name = process::text_of(folder + "comm").value_or("");
  if (state.name.ends_with('\n')) state.name.pop_back();
  return state;
}

InstructionCounter::InstructionCounter(pid_t tid) {
  perf_event_attr event{};
  event.size = sizeof event;
  event.type = PERF_TYPE_HARDWARE;
  event.config = PERF_COUNT_HW_INSTRUCTIONS;
  event.exclude_hv = 1;
  fd_ =
      process::Fd(static_cast<int>(syscall(SYS_perf_event_open, &event, tid, -1, -1, PERF_FLAG_FD_CLOEXEC)));
}

std::optional<std::uint64_t> InstructionCounter::value() const {
  std::uint64_t count = 0;
  if (fd_.get() < 0 || ::read(fd_.get(), &count, sizeof count) != sizeof count) return {};
  return count;
}

}  // namespace ontime::realtime

// SPDX-License-Identifier: Apache-2.0
// This process: its memory, its threads and their priorities, as requested and as the kernel reports them.
// Ordinary thread only; nothing here is called between the first counted message and the last.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <sys/types.h>

#include "process/process.hpp"

namespace ontime::realtime {

// SCHED_OTHER, _FIFO, _RR, _DEADLINE, by the kernel's numbers.
enum class Policy : std::uint32_t { other = 0, fifo = 1, round_robin = 2, deadline = 6 };

struct ThreadSettings {
  Policy policy = Policy::other;
  int priority = 0;       // 1 … 99 of fifo and round_robin
  std::vector<int> cpus;  // affinity; empty: leave as it is
  // Of deadline only (sched(7)): runtime ≤ deadline ≤ period.
  std::chrono::nanoseconds runtime{0}, deadline{0}, period{0};
};

// A denied request. All three texts are for people.
struct Refusal {
  std::string asked;  // "SCHED_FIFO 80 for thread send"
  std::string found;  // "Operation not permitted (RLIMIT_RTPRIO is 0)"
  std::string remedy;  // "add these lines to /etc/security/limits.d/realtime.conf …, or run as root, or: sudo
                       // setcap …"
};

// Sets one thread of this process, by its kernel thread id; affinity first, then policy. `who` names it in a
// refusal.
std::vector<Refusal> apply(pid_t tid, const std::string& who, const ThreadSettings&);
// Whether this process may have SCHED_FIFO at that priority (tried on a thread of its own).
bool may_use_fifo(int priority);

// Whether this process may lock all its memory.
bool may_lock_all();
// Locks present and future pages, keeps the heap from returning memory, and touches `heap_bytes` of heap so
// that no page fault happens later. Threads started afterwards get touched, locked stacks.
std::vector<Refusal> lock_memory(std::size_t heap_bytes);

// Keeps the CPUs from idle states with an exit latency above `latency` as long as the object lives
// (/dev/cpu_dma_latency). The kernel drops the request when this process ends, however it ends.
class CpuLatencyRequest {
 public:
  explicit CpuLatencyRequest(std::chrono::microseconds latency);
  const std::optional<Refusal>& refusal() const { return refusal_; }

 private:
  process::Fd fd_;
  std::optional<Refusal> refusal_;
};

// A thread of this process as the kernel reports it (sched_getattr, /proc/self/task/TID/{stat,status,comm}).
struct ThreadState {
  pid_t tid = 0;
  std::string name;
  Policy policy = Policy::other;
  int priority = 0;
  std::string cpus;  // a list such as "0-1,3"
  std::uint64_t minor_faults = 0, major_faults = 0;
  std::uint64_t voluntary_switches = 0, involuntary_switches = 0;
  std::chrono::nanoseconds cpu_time{0};  // user and system
};
std::optional<ThreadState> read(pid_t tid);  // nothing if the thread is gone

// Counts the instructions that a thread of this process executes, in user space and in the kernel, from now
// on.
class InstructionCounter {
 public:
  explicit InstructionCounter(pid_t tid);
  // Nothing where the CPU has no such counter (most virtual machines) or the kernel does not let us
  // (kernel.perf_event_paranoid).
  std::optional<std::uint64_t> value() const;

 private:
  process::Fd fd_;
};

// Of the text of /proc/PID/status: whether a CAP_ of <linux/capability.h> is in its effective set.
bool has_capability(const std::string& status, int capability);
// Of the text of /proc/PID/cgroup: the first of these files that is there says how much real-time CPU time
// its group has, in microseconds of each period; where none is, it is not limited so (cgroup v2).
std::vector<std::string> budget_files(const std::string& cgroup);
// Whether a kernel of that release limits real-time threads to sched_rt_runtime_us of each period. Since
// Linux 6.12 the fair server is there instead; only control groups that have a budget are limited.
bool throttles_real_time(const std::string& release, bool has_budget);
// From the same text: "ontime-pong@robot.service"; "" if it is not in a system service.
std::string service_of(const std::string& cgroup);

// Whether a kernel's release, such as "6.12.3-rt", is of this version or a later one; false if it has no
// number.
bool is_kernel_since(int major, int minor, const std::string& release);

// "fifo" ↔ Policy::fifo, as scenario files and reports write it. Nothing for another word.
std::optional<Policy> policy_of(const std::string& word);
const char* word_of(Policy);
// "0-1,3" → {0, 1, 3}. Nothing if it is not such a list or names a CPU above 1023.
std::optional<std::vector<int>> cpus_of(const std::string& list);
std::string list_of(const std::vector<int>& cpus);

}  // namespace ontime::realtime

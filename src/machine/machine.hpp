// SPDX-License-Identifier: Apache-2.0
// This machine: what it is, how busy it is, its clock, its interfaces and what went over them; and
// "machines" made of one. Ordinary thread only.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "conditions/around.hpp"

namespace ontime::journal {
class Journal;
}

namespace ontime::machine {

struct Error : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// Provenance: hostname, simulated (by what, if this machine is one of `ontime lab`), kernel (release and
// version), cpu model and count, governor, preemption model, rt_runtime_us / rt_period_us (RT throttling),
// autogroup, clocksource, limits (rtprio, memlock, cgroup memory), memory_bytes, boot_id (the same for all
// containers on this kernel), and clock: clock_state(). Unreadable values are null, never guessed.
nlohmann::json describe();

// The control group around this process that leaves it the least memory: its limit, and what is in use
// without pages of files, which the kernel takes back first. nullopt: no limit is known.
struct GroupMemory {
  std::uint64_t limit_bytes = 0, used_bytes = 0;
  std::uint64_t left_bytes() const { return limit_bytes - std::min(limit_bytes, used_bytes); }
};
std::optional<GroupMemory> group_memory();

// A control group around this process with a CPU quota, and for how long the kernel has stopped (throttled)
// its ordinary threads in all because they had used the quota up. Documentation/scheduler/sched-bwc.rst
struct GroupQuota {
  std::string file;                     // that has the quota
  double cpus = 0;                      // 0.5: half of the time of one CPU
  std::uint64_t throttled_periods = 0;  // of the quota, with such a stop
  std::uint64_t throttled_ns = 0;       // added over the CPUs
};
// The innermost first; a container hides those around it. `root`: a folder that stands for "/".
std::vector<GroupQuota> cpu_quotas(const std::string& root = "");
// That which stopped them the longest between two moments, with these two as differences; nullopt: none did.
std::optional<GroupQuota> between(const std::vector<GroupQuota>& first, const std::vector<GroupQuota>& last);

// "rt", "full", "voluntary", "none", "lazy", or, if only the kernel's version is known, "dynamic" or "none or
// voluntary". From the texts of /sys/kernel/realtime, /sys/kernel/debug/sched/preempt, /proc/cmdline and
// /proc/version (or `uname -v`), the most reliable first. Pure.
std::optional<std::string> preemption(const std::optional<std::string>& realtime,
                                      const std::optional<std::string>& debug,
                                      const std::string& command_line, const std::string& version);

// {"synchronised", "source": "ptp", "chrony" or "kernel", "error_ns": maximum error of CLOCK_REALTIME as the
// source states it, "reference": the time source (with PTP the grandmaster, possibly this machine; clocks of
// different grandmasters are not comparable), "realtime_offset_ns": CLOCK_REALTIME - CLOCK_MONOTONIC, which
// drifts}. Runs chronyc and pmc if installed, up to a second, so not during a measurement.
nlohmann::json clock_state();
// CLOCK_REALTIME - CLOCK_MONOTONIC, by the reading that took the least time.
std::int64_t realtime_offset_ns();

// How `ontime lab` describes its machine, from the kernel's command line: "QEMU 7.2.22, …"; nullopt: not a
// machine of the lab. Pure.
std::optional<std::string> simulated(const std::string& command_line);
// The word on the command line that states it.
std::string simulated_by(const std::string& what);
// In that text: the simulator's seconds are real ones.
inline constexpr const char* live_time = "live time";

// How busy the machine was between two moments: from /proc/stat and /proc/pressure.
struct Activity {
  std::uint64_t busy_ticks = 0, total_ticks = 0;
  std::uint64_t stolen_ticks = 0;  // of the busy ones: a hypervisor gave them to others
  // Microseconds in which some task waited, since boot; -1 where the kernel has no pressure information.
  std::int64_t cpu_stall_us = -1, memory_stall_us = -1, io_stall_us = -1;
  std::int64_t at_ns = 0;  // CLOCK_MONOTONIC
  // CLOCK_BOOTTIME, CLOCK_REALTIME, and the hardware's counter (CLOCK_MONOTONIC_RAW), at the same moment.
  std::int64_t boot_ns = 0, realtime_ns = 0, raw_ns = 0;
};
Activity activity();
void parse_ticks(const std::string& text, Activity&);  // of the text of /proc/stat: its first line
// {"cpu_busy": 0…1, "cpu_stolen": 0…1 (as the hypervisor reports it), "cpu_pressure": 0…1 or null,
// "memory_pressure": …, "io_pressure": …, "suspended_s": time suspended, "clock_moved_s": how far
// CLOCK_REALTIME was set forward (+) or back, "clock_slew_ppm": how much faster (+) or slower than the
// hardware counter a time service let CLOCK_MONOTONIC run, by which ontime measures}. The last three are as
// exact as two clocks can be read at the same moment.
nlohmann::json between(const Activity& first, const Activity& last);

// An interface of this machine (of this network namespace), and its IPv4 addresses.
struct Interface {
  std::string name;
  std::vector<std::string> addresses;
  bool up;
  bool loopback;
};
std::vector<Interface> interfaces();
std::optional<int> mtu_of(const std::string& interface);
std::string master_of(const std::string& interface);  // the bridge or bond that it is a port of, or ""
// The name of the interface with this IPv4 or IPv6 address, as getnameinfo() writes it.
std::optional<std::string> interface_with(const std::string& address);
// In the network namespace of that `ip netns` name ("": this process's): the interface on the route to a peer
// (address or name); and the interface with an own address (or name). Throws Error.
std::string interface_to(const std::string& peer, const std::string& network_namespace);
std::string interface_of(const std::string& own, const std::string& network_namespace);

// The kernel's counters of an interface in this process's network namespace since it came up: frames with all
// headers, of all programs. nullopt: no such interface.
struct Traffic {
  std::uint64_t sent_bytes = 0, sent_packets = 0;
  std::uint64_t received_bytes = 0, received_packets = 0;
};
std::optional<Traffic> traffic(const std::string& interface);
// The difference, by the names above; or {"gone": reason} if the interface no longer exists or is another one
// of that name.
nlohmann::json between(const Traffic& first, const std::optional<Traffic>& last);
// The difference up to now, if at least so many bytes are expected each way: some drivers refresh their
// counters only once a second, so smaller counts are read again after `wait`.
void wait_for_counters();
nlohmann::json since(const Traffic& first, const std::string& interface, std::uint64_t least_bytes,
                     const std::function<void()>& wait = wait_for_counters);

// Records when an interface was down, as the kernel reports it. Its thread is ordinary: without a CPU it
// records the time late.
class LinkWatch {
 public:
  explicit LinkWatch(const std::string& interface);  // from now on; throws Error
  ~LinkWatch();

  struct Down {
    std::int64_t from_ns, to_ns;  // CLOCK_MONOTONIC; to_ns 0: still
    bool taken;                   // taken down, or removed; false: it had no carrier
  };
  static constexpr std::size_t most = 100;  // kept: the first ones
  std::vector<Down> downs() const;

 private:
  class Listener;
  const std::unique_ptr<Listener> listener_;
};

// The kernel's drop counters for this process's network namespace. One datagram may count in several.
// nullopt: unreadable.
struct Drops {
  using Count = std::optional<std::uint64_t>;
  Count own_sockets;  // datagrams dropped at this process's UDP sockets: buffer full
  Count udp_receive;  // datagrams dropped at UDP sockets of all programs in this network namespace
  Count udp_send;     // datagrams that programs there could not send: buffer full
  Count fragments;    // datagrams with missing fragments, or without buffer space for them
  Count interface_received, interface_sent;  // frames, on that interface
  Count backlog;                             // frames, on the whole machine: a CPU's queue full
};
Drops drops(const std::string& interface);
// The difference, by the names above; null if unknown: unreadable, or set back (a closed socket takes its
// count with it).
nlohmann::json between(const Drops& first, const Drops& last);

// Names of the shared memory segments of a DDS ("fastrtps_…", "fastdds_…", "iox_…") that this process has
// mapped.
std::vector<std::string> shared_memory();

// The output of another program; nullopt if it is not installed, fails, or exceeds the limit (then it is
// killed; also once `interrupted` returns true: it does not see a terminal's Ctrl-C).
std::optional<std::string> answer_of(
    const std::vector<std::string>& command, std::chrono::nanoseconds limit,
    const std::function<bool()>& interrupted = [] { return false; });

// "Machines" made of one: network namespaces `ontime-controller` and, of each component, `ontime-NAME`, each
// with an address of 198.18.0.0/24 (RFC 2544's range for benchmarks). One component is joined to the
// controller by a veth pair; several to a bridge, which is the controller's interface, as machines to a
// switch. Needs root and iproute2's `ip`. Throws Error, or journal::Error if another program has a
// namespace of that name. With a cable, two hardware interfaces of this machine, joined by a cable, connect
// the controller and its one component instead: they are moved into the namespaces, and return when these are
// removed. Only a hardware interface returns, and only one that was down and without an address is then
// unchanged: throws Error for any other.
struct Cable {
  std::string controller, component;
};
using conditions::Wire;
struct NamespaceEnd {
  std::string host;  // "controller", or the component's name
  std::string name, interface, address;
  std::vector<std::string> prefix;  // {"ip", "netns", "exec", name}
  std::string port{};               // with several components: the port of the controller's bridge
};
// The controller's first.
std::vector<NamespaceEnd> join_namespaces(journal::Journal&,
                                          const std::vector<std::string>& components = {"component"},
                                          const std::optional<Cable>& cable = {}, const Wire& wire = {});
// Whether this process may (CAP_SYS_ADMIN and CAP_NET_ADMIN).
bool may_join_namespaces();

}  // namespace ontime::machine

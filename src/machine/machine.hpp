// SPDX-License-Identifier: Apache-2.0
// This machine: what it is, how busy it is, its clock, its interfaces and what went over them; and
// "machines" made of one. Ordinary thread only.
#pragma once

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
// that share this kernel), and clock: clock_state(). What cannot be read is null, never guessed.
nlohmann::json describe();

// "rt", "full", "voluntary", "none", "lazy", or what the kernel's version leaves open ("dynamic", "none or
// voluntary"). From the texts of /sys/kernel/realtime, /sys/kernel/debug/sched/preempt, /proc/cmdline and
// /proc/version (or `uname -v`), which say more or less, the surest first. Pure.
std::optional<std::string> preemption(const std::optional<std::string>& realtime,
                                      const std::optional<std::string>& debug,
                                      const std::string& command_line, const std::string& version);

// {"synchronised", "source": "ptp", "chrony" or "kernel", "error_ns": how far CLOCK_REALTIME is off at most
// by what the source knows, "reference": whose time it is (of PTP the grandmaster, which may be this machine;
// two of different grandmasters have nothing in common), "realtime_offset_ns": CLOCK_REALTIME -
// CLOCK_MONOTONIC, which drifts}. Asks chronyc and pmc where there are such: a second at the worst, so not
// during a measurement.
nlohmann::json clock_state();
// CLOCK_REALTIME - CLOCK_MONOTONIC, by the reading that took the least time.
std::int64_t realtime_offset_ns();

// What `ontime lab` tells a machine of itself, out of its kernel's command line: "QEMU 7.2.22, …"; nothing:
// it is no such machine. Pure.
std::optional<std::string> simulated(const std::string& command_line);
// The word of the command line that says so.
std::string simulated_by(const std::string& what);

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
// {"cpu_busy": 0…1, "cpu_stolen": 0…1 (by a hypervisor, as far as it tells), "cpu_pressure": 0…1 or null,
// "memory_pressure": …, "io_pressure": …, "suspended_s": for how long it slept, "clock_moved_s": by how much
// CLOCK_REALTIME went on more, or less, than time did; "clock_slew_ppm": by how much CLOCK_MONOTONIC, which
// all times are read from, ran fast (+) or slow beside the hardware's counter, by order of a time service;
// all three as exact as two clocks can be read at one moment}
nlohmann::json between(const Activity& first, const Activity& last);

// An interface of this machine (of this network namespace), and its first IPv4 address ("" if it has none).
struct Interface {
  std::string name;
  std::string address;
  bool up;
  bool loopback;
};
std::vector<Interface> interfaces();
// The name of the one that has this address, of IPv4 or IPv6, as getnameinfo() writes it.
std::optional<std::string> interface_with(const std::string& address);
// In the network namespace of that name, as `ip netns` has it ("": in this process's), the one by which this
// machine sends to a peer, by address or name; and the one that has an address, or that of a name, to which
// others send. Throws Error.
std::string interface_to(const std::string& peer, const std::string& network_namespace);
std::string interface_of(const std::string& own, const std::string& network_namespace);

// What has gone over an interface of this process's network namespace since it came up, as the kernel counts
// it: frames with all their headers, of all programs. Nothing if there is no such interface.
struct Traffic {
  std::uint64_t sent_bytes = 0, sent_packets = 0;
  std::uint64_t received_bytes = 0, received_packets = 0;
};
std::optional<Traffic> traffic(const std::string& interface);
// What went over it between two such moments, by the names above; or {"gone": why it is unknown}, if it is
// not there any more, or is another of that name.
nlohmann::json between(const Traffic& first, const std::optional<Traffic>& last);
// The same up to now, where at least so many bytes went each way: some drivers refresh their counters once a
// second only, so what falls short is read again after `wait`.
void wait_for_counters();
nlohmann::json since(const Traffic& first, const std::string& interface, std::uint64_t least_bytes,
                     const std::function<void()>& wait = wait_for_counters);

// When an interface could carry nothing, as the kernel reports it: by a thread of its own,
// ordinary, so some time after it was so if that gets no CPU.
class LinkWatch {
 public:
  explicit LinkWatch(const std::string& interface);  // from now on; throws Error
  ~LinkWatch();

  struct Down {
    std::int64_t from_ns, to_ns;  // CLOCK_MONOTONIC; to_ns 0: still
    bool taken;                   // taken down, or it is gone; false: it had no carrier
  };
  static constexpr std::size_t most = 100;  // that are kept, the first
  std::vector<Down> downs() const;

 private:
  class Listener;
  const std::unique_ptr<Listener> listener_;
};

// What was dropped so far where this process lives, by what the kernel counts. A datagram may be in several.
// Nothing: it cannot be read.
struct Drops {
  using Count = std::optional<std::uint64_t>;
  Count own_sockets;  // datagrams that came for this process's UDP sockets and found no room
  Count udp_receive;  // the same for all programs in this network namespace
  Count udp_send;     // that programs there could not send
  Count fragments;    // datagrams of which not all fragments came, or found room
  Count interface_received, interface_sent;  // frames, on that interface
  Count backlog;                             // frames, of the whole machine: no room in a CPU's queue
};
Drops drops(const std::string& interface);
// What was dropped between two such moments, by the names above; null where it is unknown: it could not be
// read, or was set back (a socket that was closed meanwhile took its count with it).
nlohmann::json between(const Drops& first, const Drops& last);

// Names of the shared memory segments of a DDS ("fastrtps_…", "fastdds_…", "iox_…") that this process has
// mapped.
std::vector<std::string> shared_memory();

// What another program says; nothing if it is not there, fails, or is not done within the limit (then it is
// killed).
std::optional<std::string> answer_of(const std::vector<std::string>& command, std::chrono::nanoseconds limit);

// "Machines" made of one: network namespaces `ontime-controller` and, of each component, `ontime-NAME`, each
// with an address of 198.18.0.0/24 (RFC 2544's range for benchmarks). One component is joined to the
// controller by a veth pair; several to a bridge, which is the controller's interface, as machines to a
// switch. Needs root; needs iproute2's `ip`. Throws Error, or journal::Error if another program has a
// namespace of that name. With a cable, two interfaces of this machine between which there is one join the
// controller and its one component instead: they are moved there, and come back, as they were, when the
// namespaces go. Only hardware does that, and only what is down and has no address is as it was then: throws
// Error where one is anything else.
struct Cable {
  std::string controller, component;
};
using conditions::Wire;
struct NamespaceEnd {
  std::string host;  // "controller", or the component's name
  std::string name, interface, address;
  std::vector<std::string> prefix;  // {"ip", "netns", "exec", name}
  std::string port{};  // of the bridge that the controller has then, where components are several
};
// The controller's first.
std::vector<NamespaceEnd> join_namespaces(journal::Journal&,
                                          const std::vector<std::string>& components = {"component"},
                                          const std::optional<Cable>& cable = {}, const Wire& wire = {});
// Whether this process may (CAP_SYS_ADMIN and CAP_NET_ADMIN).
bool may_join_namespaces();

}  // namespace ontime::machine

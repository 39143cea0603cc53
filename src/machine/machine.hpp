// SPDX-License-Identifier: Apache-2.0
// This machine: what it is, how busy it is, and what we change of it, with a journal and a way back.
// Ordinary thread only.
#pragma once

#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

namespace ontime::machine {

struct Error : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// Provenance: hostname, kernel (release and version), cpu model and count, governor, preemption model,
// rt_runtime_us / rt_period_us (RT throttling), clocksource, limits (rtprio, memlock, cgroup memory),
// memory_bytes. What cannot be read is null, never guessed.
nlohmann::json describe();

// How busy the machine was between two moments: from /proc/stat and /proc/pressure.
struct Activity {
  std::uint64_t busy_ticks = 0, total_ticks = 0;
  // Microseconds in which some task waited, since boot; -1 where the kernel has no pressure information.
  std::int64_t cpu_stall_us = -1, memory_stall_us = -1, io_stall_us = -1;
  std::int64_t at_ns = 0;  // CLOCK_MONOTONIC
};
Activity activity();
// {"cpu_busy": 0…1, "cpu_pressure": 0…1 or null, "memory_pressure": …, "io_pressure": …}
nlohmann::json between(const Activity& first, const Activity& last);

// An interface of this machine (of this network namespace), and its first IPv4 address ("" if it has none).
struct Interface {
  std::string name;
  std::string address;
  bool up;
  bool loopback;
};
std::vector<Interface> interfaces();

// What this process changed and how to take it back, in a file that outlives it: one journal a process, under
// /run/ontime (without root $XDG_RUNTIME_DIR/ontime, or /tmp/ontime-UID where there is none), written and
// synced before each change is made. It is owned by (pid, start time): a journal whose owner is gone is
// abandoned. A forked child owns none of it.
class Journal {
 public:
  Journal();
  ~Journal();  // takes everything back, last change first, and removes the journal
  Journal(const Journal&) = delete;
  Journal& operator=(const Journal&) = delete;

  // Each is: read, write to the journal, change, read back. Throws Error if it cannot, and then changed
  // nothing.
  void add_namespace(const std::string& name);  // removed with all that is in it
  std::string add_directory(
      const std::string& stem);  // under the temporary folder; removed with its contents
  void revert() noexcept;        // what cannot be taken back now stays in the journal for revert_abandoned()

 private:
  std::string path_;
};

// Takes back what processes that are gone (kill -9, power cut) left behind. Returns what it did, for people,
// a line each; empty if nothing was there. Cheap when there is nothing; called at every start and end of
// ontime.
std::vector<std::string> revert_abandoned();

// Two "machines" on one: namespaces `controller` and `component`, joined by a veth pair, each with an address
// of 198.18.0.0/30 (RFC 2544's range for benchmarks). Needs root; needs iproute2's `ip`. Throws Error that
// says who has a namespace of that name when one is there already.
struct NamespacePair {
  struct End {
    std::string name, interface, address;
    std::vector<std::string> prefix;  // {"ip", "netns", "exec", name}
  };
  End controller, component;
};
NamespacePair join_namespaces(Journal&);
// Whether this process may (CAP_SYS_ADMIN and CAP_NET_ADMIN).
bool may_join_namespaces();

}  // namespace ontime::machine

// SPDX-License-Identifier: Apache-2.0
// What runs on this machine beside a measurement, behind one small interface. Ordinary thread only.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "conditions/around.hpp"
#include "journal/journal.hpp"
#include "machine/machine.hpp"

namespace ontime::background {

using conditions::Faults, conditions::Workers;

struct Error : std::runtime_error {
  using std::runtime_error::runtime_error;
};

struct NeedsRoot : Error {
  using Error::Error;
};

// Files of control groups (cgroup.procs) that a process enters before it is anything else.
using Groups = std::vector<std::string>;

// Memory and disk that load may use: what is available, also in the caller's control group, less a reserve
// for all others.
struct Room {
  std::uint64_t memory_bytes, disk_bytes;
  bool disk_is_memory;  // as on a tmpfs
};
Room room_for(const std::string& directory,
              const std::optional<machine::GroupMemory>& = machine::group_memory());
struct Fitted {
  Workers workers;  // with all sizes stated
  // Which default was too large here, and whether the disk is memory, for people; "": neither.
  std::string scaled;
};
// A size that is not stated is the paper's: 256 MiB for each vm worker and 1 GiB for each hdd worker, or less
// if the room is smaller. Subtracts it from the room. Throws Error if a stated size does not fit.
Fitted fit(const Workers&, Room&);

// Runs as long as this object lives. The destructor ends it and waits until no process is left, or some
// seconds if the kernel does not let one go. When the thread that created it ends, in any way, it is killed.
class StressLoad {
 public:
  virtual ~StressLoad() = default;
  virtual bool running() = 0;  // false once it has ended by itself (no memory, say)
  // Ends it without waiting. Call it again until it returns true: no process is left.
  virtual bool end() = 0;
  virtual std::string name() const = 0;        // for people: "stress-ng (process 4711)"
  virtual std::uint64_t vm_bytes() const = 0;  // of the smallest vm worker, read back; 0: no vm worker
  // Looks at the file of each hdd worker, and returns the smallest of the largest sizes seen of each; 0: none
  // yet; nullopt: the kernel does not show the files to this process. Call it now and then: a file grows and
  // is then started anew.
  virtual std::optional<std::uint64_t> hdd_bytes() = 0;
};
// stress-ng as an ordinary process (SCHED_OTHER and any CPU, whatever the caller has; user nobody if the
// caller is root), with its temporary files in `directory`, in these groups. Returns once its workers run,
// each vm worker has its stated memory, and small files of hdd workers were seen. Throws Error if it is
// missing (with the package) or ends at once (with its output).
std::unique_ptr<StressLoad> stress(const Workers&, const std::string& directory, const Groups& = {});

// One direction of concurrent traffic, at one of its two ends: UDP, by iperf3.
struct Stream {
  std::vector<std::string> place{};  // words before the command: {"ip", "netns", "exec", "left"}
  bool serves = false;               // serves one client; else it is the client
  bool receives = false;             // set by the client: the traffic flows to it
  std::string address{};             // of the server
  std::string interface {};          // to which it binds; "": any
  int port = 0;
  // Rate of payload, without UDP, IP and Ethernet headers. The server refuses more than twice that; 0: no
  // limit.
  std::uint64_t bits_per_s = 0;
  std::uint64_t datagram_bytes = 0;  // set by the client
  int priority = 0;                  // SCHED_FIFO, of iperf3 itself; 0: ordinary
  Groups groups{};
};
// What one end reports as sent or received since its start.
struct Moved {
  // Of its own clock, up to its last report, which is 0.2 s old at most if it is not starved.
  double seconds = 0;
  double bits = 0;
};
// Runs, and ends, as StressLoad does.
class Traffic {
 public:
  virtual ~Traffic() = default;
  virtual bool running() = 0;
  virtual Moved moved() = 0;  // call it at least once a minute: else iperf3's output fills the pipe
};
// Returns once the server listens, or traffic flows. Throws Error if iperf3 is missing (with the package) or
// ends at once (with its output).
std::unique_ptr<Traffic> traffic(const Stream&);

// Throws Error for the first fault that this kernel lacks, with its key; NeedsRoot. Changes nothing.
void check(const Faults&);

// Faults and counters on an end's interface. The destructor removes them.
class Link {
 public:
  struct Place {
    std::string host;   // names the nftables tables
    std::string netns;  // as named by `ip netns`; "": this process's
    std::string interface;
  };
  // Throws Error or journal::Error, and then nothing is changed. `traffic_ports`: UDP ports that are not
  // counted.
  Link(journal::Journal&, const Place&, const Faults&, const std::vector<int>& traffic_ports);
  ~Link();
  Link(const Link&) = delete;
  Link& operator=(const Link&) = delete;

  // Drops all incoming frames for that time; the kernel itself ends the cut.
  void cut(std::chrono::milliseconds) const;
  struct Counts {
    std::uint64_t lost = 0, cut_off = 0, duplicated = 0;  // frames
    std::uint64_t sent_bytes = 0, received_bytes = 0;     // of IP, before and after the faults
    struct Etf {
      std::uint64_t launched = 0, dropped = 0;  // frames: in time; too late, or without a time
    };
    std::optional<Etf> etf{};  // sum over all etf qdiscs, if any
  };
  // Throws Error if another process removed the counters or the faults.
  Counts counts() const;

  // Removes everything before the destructor would. Returns a line for each change that could not be undone.
  std::vector<std::string> take_back();

 private:
  void give_back() noexcept;
  journal::Journal& journal_;
  const Place place_;
  std::string qdisc_;  // as the journal has it; "": none
  bool has_etf_;
  std::size_t counters_;  // how many it created
};

// The journal kinds of this module.
std::span<const journal::Kind> kinds();

}  // namespace ontime::background

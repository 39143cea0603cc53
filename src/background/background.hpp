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

namespace ontime::background {

using conditions::Faults, conditions::Workers;

struct Error : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// Files of control groups (cgroup.procs) that a process enters before it is anything else.
using Groups = std::vector<std::string>;

// What this machine has for load, but for a reserve of its own.
struct Room {
  std::uint64_t memory_bytes, disk_bytes;
  bool disk_is_memory;  // as on a tmpfs
};
Room room_for(const std::string& directory);
struct Fitted {
  Workers workers;     // with all sizes stated
  std::string scaled;  // which default was too large here, for people; "": none
};
// Sizes that are not stated are those of the paper's `stress`, 256 MiB of each vm and 1 GiB of each hdd
// worker, or what this room has for each. Takes it from the room. Throws Error where what is stated is more.
Fitted fit(const Workers&, Room&);

// Runs from its making to its destruction, which ends it and waits until nothing of it is left, or some
// seconds where the kernel does not let it go. However the thread that made it ends, it is killed then.
class StressLoad {
 public:
  virtual ~StressLoad() = default;
  virtual bool running() = 0;  // false once it has ended by itself (no memory, say)
  // Has it end; to be called until it returns true: nothing of it is left. Returns at once.
  virtual bool end() = 0;
  virtual std::string name() const = 0;        // for people: "stress-ng (process 4711)"
  virtual std::uint64_t vm_bytes() const = 0;  // of the smallest vm worker, read back; 0: there is none
  // Looks how large the file of each hdd worker is. Returns the largest that was seen until now, of the
  // worker with the smallest; 0: none yet. To be asked now and then, as a file grows and is begun anew.
  virtual std::uint64_t hdd_bytes() = 0;
};
// stress-ng as an ordinary process (SCHED_OTHER, any CPU, whatever the caller has; of the user nobody, if the
// caller is root), with its temporary files in `directory`, in these groups. Returns once its workers run,
// each vm worker has the memory that is stated, and small files of hdd workers were seen. Throws Error if it
// is missing (says the package) or ends at once (says what it said).
std::unique_ptr<StressLoad> stress(const Workers&, const std::string& directory, const Groups& = {});

// One way of concurrent traffic, as one of its two ends has it: UDP, by iperf3.
struct Stream {
  std::vector<std::string> place{};  // words before the command: {"ip", "netns", "exec", "left"}
  bool serves = false;               // serves one client; else it is the client
  bool receives = false;             // of who asks: the traffic comes here
  std::string address{};             // where it is served
  std::string interface {};          // that it takes at this end, and no other; "": whichever leads there
  int port = 0;
  // Of payload: without the headers of UDP, IP and Ethernet. Who serves refuses more than twice that; 0:
  // nothing.
  std::uint64_t bits_per_s = 0;
  std::uint64_t datagram_bytes = 0;  // of who asks
  int priority = 0;                  // SCHED_FIFO, of iperf3 itself; 0: ordinary
  Groups groups{};
};
// What one end says it has sent, or received, since it began.
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
  virtual Moved moved() = 0;  // to be asked once a minute at least: it blocks while its output is not read
};
// Returns once it waits to be asked, or traffic flows. Throws Error if it is missing (says the package), or
// ends at once (says what it said).
std::unique_ptr<Traffic> traffic(const Stream&);

// Throws Error that names the first that this kernel has not, by its key; changes nothing. Needs root.
void check(const Faults&);

// An end's interface with such faults, and the account of it, until its end, which gives it back.
class Link {
 public:
  struct Place {
    std::string host;   // whose end: names what is made
    std::string netns;  // as `ip netns` has it; "": this process's
    std::string interface;
  };
  // Throws Error or journal::Error, and then nothing is changed. `traffic_ports`: UDP's,
  // what goes by which is not counted.
  Link(journal::Journal&, const Place&, const Faults&, const std::vector<int>& traffic_ports);
  ~Link();
  Link(const Link&) = delete;
  Link& operator=(const Link&) = delete;

  // Nothing that comes arrives, for that long from now on: the kernel itself ends it.
  void cut(std::chrono::milliseconds) const;
  struct Counts {
    std::uint64_t lost = 0, cut_off = 0, duplicated = 0;  // frames
    std::uint64_t sent_bytes = 0, received_bytes = 0;     // of IP, before and after the faults
    struct Etf {
      std::uint64_t launched = 0, dropped = 0;  // frames: in time, and of which the time had passed, or none
    };
    std::optional<Etf> etf{};  // of those that there are, if any
  };
  // Throws Error if the rules that count, or the faults, are not there any more.
  Counts counts() const;

 private:
  void give_back() noexcept;
  journal::Journal& journal_;
  const Place place_;
  std::string qdisc_;  // as the journal has it; "": none
  bool has_etf_;
  std::size_t counters_;  // that it has made
};

// What of it a journal may have to give back.
std::span<const journal::Kind> kinds();

}  // namespace ontime::background

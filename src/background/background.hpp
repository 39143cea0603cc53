// SPDX-License-Identifier: Apache-2.0
// What runs on this machine beside a measurement, behind one small interface. Ordinary thread only.
#pragma once

#include <cstdint>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

namespace ontime::background {

struct Error : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// stress-ng's workers, as the paper's `stress`; 0: none of that kind.
struct Workers {
  int cpu = 0;                  // --cpu
  int vm = 0;                   // --vm
  int io = 0;                   // --iomix is not meant: --io, sync(2) over and over, as stress's -i
  int hdd = 0;                  // --hdd
  std::uint64_t vm_bytes = 0;   // of each vm worker; 0: stress-ng's default
  std::uint64_t hdd_bytes = 0;  // of each hdd worker; 0: stress-ng's default
  bool any() const { return cpu + vm + io + hdd > 0; }
};

// Runs from its making to its destruction, which ends it and waits until nothing of it is left. However the
// thread that made it ends, it does not outlive it.
class Background {
 public:
  virtual ~Background() = default;
  virtual bool running() = 0;  // false once it has ended by itself (no memory, say)
};

// stress-ng as an ordinary process (SCHED_OTHER, any CPU, whatever the caller has), with its temporary files
// in `directory`. Returns once its workers run. Throws Error if it is missing (says the package) or ends at
// once (says what it said).
std::unique_ptr<Background> stress(const Workers&, const std::string& directory);

// One way of concurrent traffic, as one of its two ends has it: UDP, by iperf3.
struct Stream {
  std::vector<std::string> place;  // words before the command: {"ip", "netns", "exec", "left"}
  bool serves = false;             // waits to be asked, by one alone; else asks whoever serves
  bool receives = false;           // of who asks: the traffic comes here
  std::string address;             // where it is served
  int port = 0;
  // Of who asks:
  std::uint64_t bits_per_s = 0;  // of payload: without the headers of UDP, IP and Ethernet
  std::uint64_t datagram_bytes = 0;
  int priority = 0;  // SCHED_FIFO, of iperf3 itself; 0: as anybody's
};
// What one end says it has sent, or received, since it began.
struct Moved {
  double seconds =
      0;  // of its own clock, up to its last report, which is 0.2 s old at most if it is not starved
  double bits = 0;
};
class Traffic : public Background {
 public:
  virtual Moved moved() = 0;  // to be asked once a minute at least: it is held up while nobody listens
};
// Returns once it waits to be asked, or traffic flows. Throws Error if it is missing (says the package), or
// ends at once (says what it said).
std::unique_ptr<Traffic> traffic(const Stream&);

}  // namespace ontime::background

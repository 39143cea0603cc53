// SPDX-License-Identifier: Apache-2.0
// What runs on this machine beside a measurement, behind one small interface. Ordinary thread only.
#pragma once

#include <cstdint>
#include <memory>
#include <stdexcept>
#include <string>

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

}  // namespace ontime::background

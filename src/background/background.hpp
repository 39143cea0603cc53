// SPDX-License-Identifier: Apache-2.0
// Load on this machine: stress-ng as a child process that cannot outlive the thread that started it, however
// that ends. Ordinary thread only.
#pragma once

#include <cstdint>
#include <stdexcept>
#include <string>

#include <sys/types.h>

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

class Stress {
 public:
  // Starts it in `directory` (its temporary files go there) and returns once its workers run. SCHED_OTHER,
  // whatever the caller has. Throws Error if stress-ng is missing (says the package) or ends at once (says
  // what it said).
  Stress(const Workers&, const std::string& directory);
  ~Stress();  // ends it and all its workers, and waits until they are gone
  Stress(const Stress&) = delete;
  Stress& operator=(const Stress&) = delete;

  bool running();  // false once it has ended by itself (no memory, say)

 private:
  pid_t pid_ = -1;
};

}  // namespace ontime::background

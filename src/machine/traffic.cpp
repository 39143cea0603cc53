// SPDX-License-Identifier: Apache-2.0
#include "machine/machine.hpp"
#include "machine/proc.hpp"

namespace ontime::machine {

std::optional<Traffic> traffic(const std::string& interface) {
  return parse_traffic(text_of("/proc/thread-self/net/dev").value_or(""), interface);
}

std::vector<std::string> shared_memory() { return parse_segments(text_of("/proc/self/maps").value_or("")); }

}  // namespace ontime::machine

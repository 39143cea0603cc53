// SPDX-License-Identifier: Apache-2.0
#include "machine/machine.hpp"
#include "machine/proc.hpp"

namespace ontime::machine {

std::optional<Traffic> traffic(const std::string& interface) {
  return parse_traffic(text_of("/proc/thread-self/net/dev").value_or(""), interface);
}

nlohmann::json between(const Traffic& first, const std::optional<Traffic>& last) {
  if (!last) return {{"gone", "the interface is not there any more"}};
  auto result = nlohmann::json::object();
  const std::pair<const char*, std::uint64_t Traffic::*> counters[] = {
      {"sent_bytes", &Traffic::sent_bytes},
      {"sent_packets", &Traffic::sent_packets},
      {"received_bytes", &Traffic::received_bytes},
      {"received_packets", &Traffic::received_packets}};
  for (const auto& [name, counter] : counters) {
    if ((*last).*counter < first.*counter)
      return {{"gone", "the interface's counters were set back: it is another of that name"}};
    result[name] = (*last).*counter - first.*counter;
  }
  return result;
}

std::vector<std::string> shared_memory() { return parse_segments(text_of("/proc/self/maps").value_or("")); }

}  // namespace ontime::machine

// SPDX-License-Identifier: Apache-2.0
#include <thread>

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

void wait_for_counters() { std::this_thread::sleep_for(std::chrono::milliseconds(1100)); }

nlohmann::json since(const Traffic& first, const std::string& interface, std::uint64_t least_bytes,
                     const std::function<void()>& wait) {
  const auto now = traffic(interface);
  const auto enough = [&](std::uint64_t Traffic::*bytes) {
    return !now || (*now).*bytes < first.*bytes || (*now).*bytes - first.*bytes >= least_bytes;
  };
  if (enough(&Traffic::sent_bytes) && enough(&Traffic::received_bytes)) return between(first, now);
  wait();
  return between(first, traffic(interface));
}

std::vector<std::string> shared_memory() { return parse_segments(text_of("/proc/self/maps").value_or("")); }

}  // namespace ontime::machine

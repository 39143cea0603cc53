// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "machine/clock.hpp"
#include "machine/machine.hpp"
#include "machine/proc.hpp"

namespace ontime::machine {
namespace {

nlohmann::json share(std::int64_t part, std::int64_t whole) {
  if (whole <= 0) return nullptr;
  // The two are not read at the same instant, and the kernel's idle counters may step back a little.
  return std::clamp(static_cast<double>(part) / static_cast<double>(whole), 0.0, 1.0);
}

nlohmann::json pressure(std::int64_t first_us, std::int64_t last_us, std::int64_t elapsed_ns) {
  if (first_us < 0 || last_us < 0) return nullptr;
  return share(last_us - first_us, elapsed_ns / 1000);
}

nlohmann::json seconds(std::int64_t time_ns, std::int64_t elapsed_ns) {
  if (elapsed_ns <= 0) return nullptr;
  return static_cast<double>(time_ns) / 1e9;
}

nlohmann::json slew_ppm(std::int64_t elapsed_ns, std::int64_t raw_elapsed_ns) {
  if (elapsed_ns <= 0 || raw_elapsed_ns <= 0) return nullptr;
  return static_cast<double>(elapsed_ns - raw_elapsed_ns) / static_cast<double>(raw_elapsed_ns) * 1e6;
}

}  // namespace

Activity activity() {
  Activity now;
  const auto [monotonic_ns, raw_ns] = read_beside_monotonic(CLOCK_MONOTONIC_RAW);
  now.at_ns = monotonic_ns;
  now.raw_ns = raw_ns;
  now.boot_ns = read_ns(CLOCK_BOOTTIME);
  now.realtime_ns = read_ns(CLOCK_REALTIME);
  parse_ticks(text_of("/proc/stat").value_or(""), now);
  now.cpu_stall_us = parse_stall(text_of("/proc/pressure/cpu").value_or(""));
  now.memory_stall_us = parse_stall(text_of("/proc/pressure/memory").value_or(""));
  now.io_stall_us = parse_stall(text_of("/proc/pressure/io").value_or(""));
  return now;
}

nlohmann::json between(const Activity& first, const Activity& last) {
  const auto elapsed_ns = last.at_ns - first.at_ns;
  const auto ticks = static_cast<std::int64_t>(last.total_ticks - first.total_ticks);
  return {{"cpu_busy", share(static_cast<std::int64_t>(last.busy_ticks - first.busy_ticks), ticks)},
          {"cpu_stolen", share(static_cast<std::int64_t>(last.stolen_ticks - first.stolen_ticks), ticks)},
          {"cpu_pressure", pressure(first.cpu_stall_us, last.cpu_stall_us, elapsed_ns)},
          {"memory_pressure", pressure(first.memory_stall_us, last.memory_stall_us, elapsed_ns)},
          {"io_pressure", pressure(first.io_stall_us, last.io_stall_us, elapsed_ns)},
          {"suspended_s", seconds(last.boot_ns - first.boot_ns - elapsed_ns, elapsed_ns)},
          {"clock_moved_s",
           seconds(last.realtime_ns - first.realtime_ns - (last.boot_ns - first.boot_ns), elapsed_ns)},
          {"clock_slew_ppm", slew_ppm(elapsed_ns, last.raw_ns - first.raw_ns)}};
}

}  // namespace ontime::machine

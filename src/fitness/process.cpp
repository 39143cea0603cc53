// SPDX-License-Identifier: Apache-2.0
// The limits of the caller's programs: priorities and locked memory.
#include <charconv>
#include <sstream>
#include <string_view>

#include <fmt/format.h>
#include <linux/capability.h>

#include "fitness/look.hpp"
#include "realtime/privileges.hpp"
#include "realtime/realtime.hpp"

namespace ontime::fitness {
namespace {

realtime::Privileges own(const Look& look) {
  return {look.text("/proc/self/status").value_or(""), look.text("/proc/self/uid_map").value_or("")};
}

// A service gets its limits from its unit, not at a login.
std::string how_to_permit(const Look& look) {
  const auto text = [&](const char* path) { return look.text(path).value_or(""); };
  if (auto by_unit = realtime::how_to_permit_service(text("/proc/self/environ"), text("/proc/self/cgroup"));
      !by_unit.empty())
    return by_unit;
  if (auto by_container = realtime::how_to_permit_container(own(look)); !by_container.empty())
    return by_container;
  return "write \"@realtime - rtprio 98\" and \"@realtime - memlock unlimited\" into "
         "/etc/security/limits.d/realtime.conf; then "
         "sudo groupadd --force realtime && sudo usermod --append --groups realtime $USER, and log in again";
}

// The soft limit, which is the first of the columns.
std::string limit(const Look& look, const char* name) {
  const auto limits = look.text("/proc/self/limits").value_or("");
  const auto row = limits.find(name);
  if (row == limits.npos) return "";
  std::istringstream columns(limits.substr(row + std::string_view(name).size()));
  std::string soft;
  columns >> soft;
  return soft;
}

}  // namespace

Findings priority_limit(const Look& look) {
  const auto most = limit(look, "Max realtime priority");
  if (most.empty()) return {};
  if (own(look).has(CAP_SYS_NICE)) return {fine("any (CAP_SYS_NICE)")};
  constexpr int needed = 80;
  int priority = 0;
  std::from_chars(most.data(), most.data() + most.size(), priority);
  if (most == "unlimited" || priority >= needed) return {fine("up to " + most)};
  return {{Severity::wrong, fmt::format("real-time priorities up to {} are permitted", most),
           fmt::format("{} or more", needed),
           "without a real-time priority, your threads wait while other programs compute",
           how_to_permit(look)}};
}

Findings memory_limit(const Look& look) {
  const auto most = limit(look, "Max locked memory");
  if (most.empty()) return {};
  if (most == "unlimited" || own(look).has(CAP_IPC_LOCK)) return {fine("unlimited")};
  return {{Severity::wrong, fmt::format("{} bytes may be locked", most), "unlimited",
           "a page that is not locked may have to be read from disk, which takes milliseconds",
           how_to_permit(look)}};
}

Findings priority_budget(const Look& look) {
  for (const auto& file : realtime::budget_files(look.text("/proc/self/cgroup").value_or(""))) {
    const auto budget = look.number(file);
    if (!budget) continue;
    if (*budget < 0) return {fine("unlimited")};
    if (*budget > 0) return {fine(fmt::format("{} µs of each period", *budget))};
    return {{Severity::wrong, "0 µs: this control group has no real-time budget", "more than 0 µs",
             "no program in it can have a real-time priority, not even as root",
             fmt::format("echo 900000 | sudo tee {} (its parents first)", file)}};
  }
  return {};
}

Findings swap(const Look& look) {
  const auto swaps = look.text("/proc/swaps");
  if (!swaps) return {};
  if (swaps->find('\n') == swaps->npos) return {fine("off")};
  return {{Severity::hint, "on", "off, or all memory of the robot's programs locked",
           "swapped memory has to be read from disk, which takes milliseconds",
           "mlockall(MCL_CURRENT | MCL_FUTURE) in the program (as ontime does with realtime on); or sudo "
           "swapoff --all, "
           "and remove it from /etc/fstab"}};
}

Findings huge_pages(const Look& look) {
  const auto mode = look.text("/sys/kernel/mm/transparent_hugepage/enabled");
  if (!mode) return {};
  if (mode->find("[always]") == mode->npos) return {fine(*mode)};
  return {{Severity::hint, *mode, "madvise or never",
           "the program waits while the kernel merges small pages into large ones",
           "echo madvise | sudo tee /sys/kernel/mm/transparent_hugepage/enabled"}};
}

Findings memory_balancing(const Look& look) {
  const auto on = look.number("/proc/sys/kernel/numa_balancing");
  if (!on || *on == 0) return {};
  return {
      {Severity::hint, "on", "off",
       "the kernel unmaps pages, locked ones too, to see which thread uses them: each causes a page fault",
       "sudo sysctl kernel.numa_balancing=0"}};
}

// Documentation/admin-guide/sysctl/vm.rst: the default is 1, under PREEMPT_RT 0.
Findings compaction(const Look& look) {
  const auto moves = look.number("/proc/sys/vm/compact_unevictable_allowed");
  if (!moves) return {};
  if (*moves == 0) return {fine("not for locked memory")};
  return {{Severity::hint, "also for locked memory", "not for locked memory",
           "the kernel moves pages to make room for large ones; each moved page causes a page fault",
           "sudo sysctl vm.compact_unevictable_allowed=0"}};
}

}  // namespace ontime::fitness

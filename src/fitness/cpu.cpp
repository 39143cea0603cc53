// SPDX-License-Identifier: Apache-2.0
// The CPUs: frequency, idle states, isolation, virtualisation.
#include <algorithm>
#include <map>
#include <sstream>
#include <thread>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "fitness/look.hpp"
#include "machine/machine.hpp"
#include "realtime/realtime.hpp"
#include "table/table.hpp"

namespace ontime::fitness {
namespace {

constexpr const char* folder = "/sys/devices/system/cpu/";

std::vector<std::string> cpus(const Look& look) {
  auto names = look.names(folder);
  std::erase_if(names, [](const std::string& name) {
    return !name.starts_with("cpu") || name.size() == 3 ||
           name.find_first_not_of("0123456789", 3) != name.npos;
  });
  return names;
}

}  // namespace

Findings governor(const Look& look) {
  std::map<std::string, int> governors;
  for (const auto& cpu : cpus(look))
    if (const auto one = look.text(folder + cpu + "/cpufreq/scaling_governor")) ++governors[*one];
  if (governors.empty()) return {};
  if (governors.size() == 1 && governors.contains("performance")) return {fine("performance")};
  const auto words = table::texts_of(
      governors, [](const auto& one) { return fmt::format("{} on {} CPUs", one.first, one.second); });
  return {{Severity::wrong, fmt::format("{}", fmt::join(words, ", ")), "performance",
           "between messages the CPU slows down; it needs milliseconds to speed up when one arrives",
           "sudo ontime tune apply --set governor=performance"}};
}

Findings idle_states(const Look& look) {
  constexpr std::int64_t enough_us = 10;
  std::int64_t deepest_us = -1;
  std::string name;
  for (const auto& cpu : cpus(look))
    for (const auto& state : look.names(folder + cpu + "/cpuidle")) {
      const auto path = fmt::format("{}{}/cpuidle/{}", folder, cpu, state);
      const auto latency = look.number(path + "/latency");
      if (!latency || look.number(path + "/disable") == 1 || *latency <= deepest_us) continue;
      deepest_us = *latency;
      name = look.text(path + "/name").value_or(state);
    }
  if (deepest_us < 0) return {};
  const auto is = fmt::format("the deepest is {}: {} µs to leave", name, deepest_us);
  if (deepest_us <= enough_us) return {fine(is)};
  const bool is_pc = process::field(look.text("/proc/cpuinfo").value_or(""), "flags").has_value();
  return {{Severity::hint, is,
           fmt::format("at most {} µs to leave, while a program waits for messages", enough_us),
           "the first message after a pause waits until the CPU wakes up",
           fmt::format(
               "write 0 to /dev/cpu_dma_latency in the robot's program and keep it open (ontime: realtime "
               "on); or for all programs: {} on the kernel's command line",
               is_pc ? "intel_idle.max_cstate=1 processor.max_cstate=1" : "cpuidle.off=1")}};
}

Findings smt(const Look& look) {
  const auto active = look.number(std::string(folder) + "smt/active");
  if (!active) return {};
  if (*active == 0) return {fine("off")};
  return {
      {Severity::hint, "on", "off", "two CPUs share one core: work on one slows the other, at any priority",
       "echo off | sudo tee /sys/devices/system/cpu/smt/control; permanently: nosmt on the kernel's command "
       "line"}};
}

Findings isolation(const Look& look) {
  const auto isolated = look.text(std::string(folder) + "isolated");
  if (!isolated) return {};
  if (!isolated->empty()) return {fine(*isolated)};
  if (cpus(look).size() < 2) return {};
  return {
      {Severity::hint, "none", "one or more, if priorities are not enough",
       "other programs use the same caches, and their interrupts interrupt the robot's threads",
       "isolcpus=managed_irq,domain,N nohz_full=N rcu_nocbs=N on the kernel's command line; then give the "
       "robot's threads CPU N (realtime.cpus in a scenario); for a run without reboot: isolation.cpus"}};
}

// Only the kernel's command line can do this: a CPU without other threads still has its tick.
Findings full_isolation(const Look& look) {
  const auto isolated = realtime::cpus_of(look.text(std::string(folder) + "isolated").value_or(""));
  if (!isolated || isolated->empty()) return {};
  const auto cpus = realtime::list_of(*isolated);
  std::istringstream words(look.text("/proc/cmdline").value_or(""));
  std::string isolcpus, callbacks;
  for (std::string word; words >> word;) {
    if (word.starts_with("isolcpus=")) isolcpus = word.substr(9);
    if (word.starts_with("rcu_nocbs=")) callbacks = word.substr(10);
  }
  const auto has_all = [&](const std::string& list) {
    const auto given = realtime::cpus_of(list).value_or(std::vector<int>{});
    return list == "all" || std::all_of(isolated->begin(), isolated->end(), [&](int cpu) {
             return std::ranges::find(given, cpu) != given.end();
           });
  };
  const auto tickless = look.text(std::string(folder) + "nohz_full");
  const bool without_tick = has_all(tickless.value_or(""));
  std::vector<std::string> lacking;
  if (!tickless) lacking.emplace_back("nohz_full (this kernel is built without CONFIG_NO_HZ_FULL)");
  if (tickless && !without_tick) lacking.emplace_back("nohz_full");
  if (!without_tick && !has_all(callbacks)) lacking.emplace_back("rcu_nocbs");  // the one brings the other
  if (isolcpus.find("managed_irq") == isolcpus.npos) lacking.emplace_back("managed_irq");
  if (lacking.empty())
    return {fine(fmt::format("CPUs {}: no tick, no RCU callbacks, no managed interrupts", cpus))};
  return {
      {Severity::hint, fmt::format("CPUs {} are isolated without {}", cpus, fmt::join(lacking, ", ")),
       "all three",
       "the tick, RCU callbacks, and interrupts that a driver manages (NVMe, network cards) still run there",
       fmt::format("isolcpus=managed_irq,domain,{0} nohz_full={0} rcu_nocbs={0} on the kernel's command line",
                   cpus)}};
}

Findings virtualisation(const Look& look) {
  std::istringstream flags(process::field(look.text("/proc/cpuinfo").value_or(""), "flags").value_or(""));
  for (std::string flag; flags >> flag;)
    if (flag == "hypervisor")
      return {{Severity::hint, "a virtual machine", "real hardware",
               "the host may pause it at any time; no setting in the guest prevents that",
               "use it to compare settings; measure the robot on the robot"}};
  return {};
}

Findings stolen_time(const Look& look) {
  constexpr double much = 0.001;
  machine::Activity since_start;
  machine::parse_ticks(look.text("/proc/stat").value_or(""), since_start);
  if (since_start.stolen_ticks == 0) return {};
  const auto share =
      static_cast<double>(since_start.stolen_ticks) / static_cast<double>(since_start.total_ticks);
  const auto is = table::percent(share, 2) + " % of the time since boot";
  if (share < much) return {fine(is)};
  return {{Severity::wrong, is, "none",
           "for that time this machine's CPUs had work, but the host ran other machines on them",
           "pin the virtual CPUs to CPUs of the host (libvirt: vcpupin), or use real hardware"}};
}

// That of a group around it may be unknown: without a quota nothing is said.
Findings cpu_quota(const Look& look) {
  const auto quotas = machine::cpu_quotas(look.subject().root);
  const auto least = std::ranges::min_element(quotas, {}, &machine::GroupQuota::cpus);
  if (least == quotas.end()) return {};
  if (least->cpus >= std::thread::hardware_concurrency() && least->throttled_periods == 0) return {};
  const auto stops = table::many(least->throttled_periods, "stop", "stops");
  return {
      {Severity::hint,
       fmt::format("this control group may use {:.3g} CPUs: {} so far, {:.1f} s added over CPUs", least->cpus,
                   stops, static_cast<double>(least->throttled_ns) / 1e9),
       "no quota, or more than the robot's programs ever use",
       "when it is used up, all ordinary threads of the group stop until its next period (often 100 ms)",
       fmt::format("raise or remove it (docker --cpus, Kubernetes limits.cpu, systemd CPUQuota=; by hand: "
                   "echo {} | sudo tee {}); or give threads a real-time priority: it does not stop these",
                   least->file.ends_with("cpu.max") ? "max" : "-1", least->file)}};
}

}  // namespace ontime::fitness

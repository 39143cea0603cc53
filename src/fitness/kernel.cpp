// SPDX-License-Identifier: Apache-2.0
// The kernel: preemption, throttling, timers, clocks.
#include <algorithm>
#include <sstream>
#include <string_view>

#include <fmt/format.h>

#include "fitness/look.hpp"
#include "machine/machine.hpp"
#include "realtime/realtime.hpp"

namespace ontime::fitness {
namespace {

std::string how_to_install_rt(const Look& look) {
  auto release = look.text("/etc/os-release");
  if (!release) release = look.text("/usr/lib/os-release");
  std::istringstream lines(release.value_or(""));
  std::string distributions;  // this one, and those that it is made from
  for (std::string line; std::getline(lines, line);)
    if (line.starts_with("ID=") || line.starts_with("ID_LIKE=")) distributions += line;
  const auto is = [&](const char* name) { return distributions.find(name) != std::string::npos; };
  if (is("ubuntu")) return "sudo pro attach && sudo pro enable realtime-kernel (Ubuntu Pro), and reboot";
  if (is("debian")) return "sudo apt install linux-image-rt-amd64 (arm64: linux-image-rt-arm64), and reboot";
  return "install a PREEMPT_RT kernel of your distribution, and reboot";
}

bool throttles(const Look& look) {
  constexpr std::string_view before = "Linux version ";
  const auto version = look.text("/proc/version").value_or("");
  const bool has_budget =
      std::ranges::any_of(realtime::budget_files(look.text("/proc/self/cgroup").value_or("")),
                          [&](const auto& file) { return look.exists(file); });
  return !version.starts_with(before) ||
         realtime::throttles_real_time(version.substr(before.size()), has_budget);
}

}  // namespace

Findings preemption(const Look& look) {
  auto model =
      machine::preemption(look.text("/sys/kernel/realtime"), look.text("/sys/kernel/debug/sched/preempt"),
                          look.text("/proc/cmdline").value_or(""), look.text("/proc/version").value_or(""));
  if (model == "rt") return {fine("PREEMPT_RT")};
  if (model == "dynamic") model.reset();
  Finding finding{Severity::hint,
                  fmt::format("not PREEMPT_RT; preemption: {}", model.value_or("as the kernel was built")),
                  "PREEMPT_RT", "every thread waits until interrupts, softirqs and kernel locks end",
                  how_to_install_rt(look)};
  // Lazy preemption delays the preemption of ordinary threads only.
  if (model && *model != "full" && *model != "lazy") {
    finding.severity = Severity::wrong;
    finding.why = "a real-time thread waits until a system call of any other program ends or sleeps";
    finding.remedy += "; until then: preempt=full on the kernel's command line, if it is PREEMPT_DYNAMIC";
  }
  return {finding};
}

Findings throttling(const Look& look) {
  const auto runtime = look.number("/proc/sys/kernel/sched_rt_runtime_us"),
             period = look.number("/proc/sys/kernel/sched_rt_period_us");
  if (!runtime || !period) return {};
  if (*runtime < 0 || *runtime >= *period) return {fine("off")};
  if (!throttles(look))
    return {
        fine("Linux 6.12 and later have the fair server instead, unless built with CONFIG_RT_GROUP_SCHED")};
  return {{Severity::hint, fmt::format("real-time threads get at most {} of every {} µs", *runtime, *period),
           "off, if no real-time thread runs forever",
           "real-time threads that run longer, all together, are stopped until the period ends",
           "sudo ontime tune apply --set rt-throttling=off"}};
}

Findings fair_server(const Look& look) {
  const std::string folder = "/sys/kernel/debug/sched/fair_server";
  for (const auto& cpu : look.names(folder))
    if (const auto runtime = look.number(fmt::format("{}/{}/runtime", folder, cpu)); runtime && *runtime > 0)
      return {{Severity::hint,
               fmt::format("{} reserves {} ns of each period for ordinary threads", cpu, *runtime),
               "0 on CPUs for real-time threads only",
               "starving ordinary threads run before real-time threads for that long",
               // Only root can list the folder, and so expand the *.
               fmt::format("sudo sh -c 'for f in {}/cpu*/runtime; do echo 0 >$f; done'", folder)}};
  return {};
}

Findings autogroup(const Look& look) {
  const auto on = look.number("/proc/sys/kernel/sched_autogroup_enabled");
  if (!on) return {};
  if (*on == 0) return {fine("off")};
  return {{Severity::hint, "on", "off",
           "niceness counts only within a session, so nice and renice have little effect on ordinary threads",
           "sudo sysctl kernel.sched_autogroup_enabled=0"}};
}

Findings timer_migration(const Look& look) {
  const auto on = look.number("/proc/sys/kernel/timer_migration");
  if (!on) return {};
  const auto isolated = look.text("/sys/devices/system/cpu/isolated").value_or("");
  if (*on == 0 || isolated.empty()) return {fine(*on == 0 ? "off" : "on; no CPU is isolated")};
  return {{Severity::hint, "on", "off where CPUs are isolated",
           "timers of idle CPUs run on busy CPUs, possibly on isolated ones",
           "sudo ontime tune apply --set timer-migration=off"}};
}

Findings clock_source(const Look& look) {
  const std::string folder = "/sys/devices/system/clocksource/clocksource0/";
  const auto current = look.text(folder + "current_clocksource");
  if (!current) return {};
  for (const auto* slow : {"hpet", "acpi_pm", "jiffies", "refined-jiffies"})
    if (*current == slow)
      return {
          {Severity::wrong, *current, "tsc; on machines other than PCs the CPU's own counter",
           "reading the clock takes microseconds, and every program reads it",
           fmt::format("available: {}; find why the kernel rejects tsc (sudo dmesg | grep -i tsc); if tsc "
                       "is reliable: tsc=reliable on the kernel's command line",
                       look.text(folder + "available_clocksource").value_or("?"))}};
  return {fine(*current)};
}

Findings clock_synchronised(const Look& look) {
  const auto& subject = look.subject();
  const auto synchronised =
      subject.root.empty() ? machine::clock_state().at("synchronised").get<bool>() : subject.synchronised;
  if (!synchronised) return {};
  if (*synchronised) return {fine("synchronised")};
  return {{Severity::hint, "not synchronised", "synchronised, best by PTP",
           "between two machines only the round trip can be measured, not the request and reply legs",
           "sudo apt install chrony; or linuxptp, if both network cards have clocks (ethtool -T)"}};
}

}  // namespace ontime::fitness

// SPDX-License-Identifier: Apache-2.0
// Things that are one file of /proc or /sys each.
#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>

#include <fmt/format.h>
#include <net/if.h>
#include <sys/mount.h>
#include <sys/stat.h>
#include <unistd.h>

#include "process/process.hpp"
#include "realtime/realtime.hpp"
#include "settings/file.hpp"
#include "settings/kinds.hpp"

namespace ontime::settings {
namespace {

using journal::Scope;
using journal::Value;

constexpr const char* cpus_folder = "/sys/devices/system/cpu";

// A thing is not gone where its folder is not visible, as in a service with ProcSubset=pid.
Value seen(Value value, const char* folder) {
  if (!value && access(folder, F_OK) != 0)
    throw journal::Error(fmt::format("{} is not visible here (in a container?)", folder));
  return value;
}

template <std::string (*path)(const std::string&)>
void write(const std::string& what, const Value& value, const Value&) {
  write_file(path(what), value.value_or(""));
}

bool is_network_sysctl(const std::string& what) {
  constexpr std::array known = {"net/core/busy_poll", "net/core/busy_read",    "net/core/rmem_default",
                                "net/core/rmem_max",  "net/core/wmem_default", "net/core/wmem_max"};
  return std::ranges::find(known, what) != known.end();
}
bool is_kernel_sysctl(const std::string& what) {
  return what == "kernel/sched_rt_runtime_us" || what == "kernel/timer_migration";
}
std::string sysctl_path(const std::string& what) { return "/proc/sys/" + what; }
Value read_sysctl(const std::string& what) { return seen(read_file(sysctl_path(what)), "/proc/sys/kernel"); }

bool is_numbered(const std::string& name, std::string_view prefix) {
  return name.starts_with(prefix) && name.size() > prefix.size() && name.size() < prefix.size() + 8 &&
         std::all_of(name.begin() + static_cast<std::ptrdiff_t>(prefix.size()), name.end(),
                     [](char c) { return c >= '0' && c <= '9'; });
}

bool is_cpu(const std::string& what) { return is_numbered(what, "cpu"); }
std::string governor_path(const std::string& cpu) {
  return fmt::format("{}/{}/cpufreq/scaling_governor", cpus_folder, cpu);
}
Value read_governor(const std::string& cpu) { return seen(read_file(governor_path(cpu)), cpus_folder); }

bool is_interrupt(const std::string& what) { return is_numbered(what.substr(0, what.find(':')), ""); }
std::string interrupt_path(const std::string& what) {
  return fmt::format("/proc/irq/{}/smp_affinity_list", what.substr(0, what.find(':')));
}
// The kernel gives the number of a removed interrupt to another device.
bool is_same_interrupt(const std::string& what) { return what == interrupt_here(std::stoi(what)); }
Value read_interrupt(const std::string& what) {
  if (!is_same_interrupt(what)) return seen({}, "/sys/kernel/irq");
  return seen(read_file(interrupt_path(what)), "/proc/irq");
}
void write_interrupt(const std::string& what, const Value& value, const Value&) {
  if (!is_same_interrupt(what))
    throw journal::Error(fmt::format("interrupt {} belongs to another device now", what));
  write_file(interrupt_path(what), value.value_or(""));
}

bool is_unbound(const std::string& what) { return what == "unbound"; }

std::string threaded_path(const std::string& interface) {
  return folder_of_interface(interface) + "/threaded";
}

Value read_threaded(const std::string& interface) { return read_file(threaded_path(interface)); }

// Only the write shows whether the interface has a NAPI that could have threads.
void write_threaded(const std::string& interface, const Value& value) {
  try {
    write_file(threaded_path(interface), value.value_or(""));
  } catch (const journal::Error& error) {
    throw journal::Error(
        fmt::format("{} ({} may have no NAPI; a veth interface needs gro on)", error.what(), interface));
  }
}

bool is_queue(const std::string& what) {
  const auto slash = what.find('/');
  return slash != what.npos && is_interface(what.substr(0, slash)) &&
         is_numbered(what.substr(slash + 1), "rx-");
}
std::string steering_path(const std::string& what) {
  const auto slash = what.find('/');
  return fmt::format("{}/queues/{}/rps_cpus", folder_of_interface(what.substr(0, slash)),
                     what.substr(std::min(what.size(), slash + 1)));
}

// "00000000,00000003", the highest CPUs first, 32 in a group.
std::string list_of_mask(const std::string& mask) {
  std::vector<int> cpus;
  int cpu = 0;
  for (auto digit = mask.rbegin(); digit != mask.rend(); ++digit) {
    if (*digit == ',') continue;
    const auto bits = std::stoul(std::string(1, *digit), nullptr, 16);
    for (int bit = 0; bit < 4; ++bit, ++cpu)
      if ((bits >> static_cast<unsigned>(bit) & 1U) != 0) cpus.push_back(cpu);
  }
  return cpus.empty() ? "none" : realtime::list_of(cpus);
}
std::string mask_of_list(const std::string& list) {
  const auto cpus = realtime::cpus_of(list).value_or(std::vector<int>{});
  const int highest = cpus.empty() ? 0 : *std::max_element(cpus.begin(), cpus.end());
  std::vector<std::uint32_t> groups(static_cast<std::size_t>(highest) / 32 + 1, 0);
  for (const int cpu : cpus)
    groups[static_cast<std::size_t>(cpu) / 32] |= 1U << (static_cast<unsigned>(cpu) % 32);
  std::string mask;
  for (auto group = groups.rbegin(); group != groups.rend(); ++group)
    mask += fmt::format("{}{:08x}", mask.empty() ? "" : ",", *group);
  return mask;
}
Value read_mask(const std::string& path) {
  const auto mask = read_file(path);
  return mask ? Value(list_of_mask(*mask)) : Value();
}

Value read_steering(const std::string& queue) { return read_mask(steering_path(queue)); }
void write_steering(const std::string& queue, const Value& value) {
  write_file(steering_path(queue), mask_of_list(value.value_or("none")));
}

constexpr const char* workqueues_path = "/sys/devices/virtual/workqueue/cpumask";
Value read_workqueues(const std::string&) { return seen(read_mask(workqueues_path), cpus_folder); }
void write_workqueues(const std::string&, const Value& value, const Value&) {
  write_file(workqueues_path, mask_of_list(value.value_or("none")));
}

// The kernel has one sysfs for each network namespace, and mounts it again wherever it is asked to. False
// where this process may not ask.
bool sys_is_of_another_namespace() {
  const process::Fd context(fsopen("sysfs", FSOPEN_CLOEXEC));
  if (context.get() < 0 || fsconfig(context.get(), FSCONFIG_CMD_CREATE, nullptr, nullptr, 0) != 0)
    return false;
  const process::Fd own(fsmount(context.get(), FSMOUNT_CLOEXEC, 0));
  struct stat here {
  }, shown{};
  return own.get() >= 0 && fstat(own.get(), &here) == 0 && stat("/sys", &shown) == 0 &&
         here.st_dev != shown.st_dev;
}

}  // namespace

std::string folder_of_interface(const std::string& name) {
  if (sys_is_of_another_namespace())
    throw journal::Error(fmt::format(
        "/sys does not show interface {}: it is of another network namespace (nsenter --net?), or not "
        "mounted. Fix: enter the namespace with ip netns exec, or mount -t sysfs sysfs /sys",
        name));
  return "/sys/class/net/" + name;
}
std::string interface_here(const std::string& name) {
  return fmt::format("{}:{}", if_nametoindex(name.c_str()), name);
}
bool is_interface(const std::string& what) {
  int index = 0;  // more than that the kernel gives none
  const auto colon = what.find_first_not_of("0123456789");
  return colon != what.npos && colon > 0 && what[colon] == ':' &&
         std::from_chars(what.data(), what.data() + colon, index).ec == std::errc{} &&
         journal::is_interface_name(what.substr(colon + 1));
}
std::optional<std::string> name_now(const std::string& interface_or_queue) {
  const auto slash = std::min(interface_or_queue.find('/'), interface_or_queue.size());
  const auto index = static_cast<unsigned>(std::stoul(interface_or_queue));
  std::array<char, IF_NAMESIZE> name{};
  if (if_indextoname(index, name.data()) != nullptr) return name.data() + interface_or_queue.substr(slash);
  // One that was renamed on its way is not found: there, its index may be any interface's.
  const auto before = name_of_interface(interface_or_queue.substr(0, slash));
  if (geteuid() == 0 && in_another_namespace([&] { return if_nametoindex(before.c_str()) != 0; }))
    throw journal::Error(
        fmt::format("interface {} (index {}) was moved to another network namespace, or removed; its changed "
                    "settings may still be in effect there",
                    before, index));
  return {};
}
std::string name_of_interface(const std::string& interface_or_queue) {
  return interface_or_queue.substr(interface_or_queue.find(':') + 1);
}

const journal::Kind network_sysctl = {"network sysctl", Scope::network_namespace, is_network_sysctl,
                                      read_sysctl, write<sysctl_path>};
const journal::Kind kernel_sysctl = {"kernel sysctl", Scope::machine, is_kernel_sysctl, read_sysctl,
                                     write<sysctl_path>};
const journal::Kind governor = {"governor", Scope::machine, is_cpu, read_governor, write<governor_path>};
const journal::Kind workqueues = {"workqueues", Scope::machine, is_unbound, read_workqueues,
                                  write_workqueues};
const journal::Kind interrupt = {"interrupt", Scope::machine, is_interrupt, read_interrupt, write_interrupt};
const journal::Kind threaded =
    kind_of_interface<read_threaded, write_threaded>("threaded NAPI", is_interface);
const journal::Kind steering =
    kind_of_interface<read_steering, write_steering>("receive packet steering", is_queue);

std::optional<File> file_of(const Thing& thing, const std::string& value) {
  const auto* const kind = thing.kind;
  if (kind == &network_sysctl || kind == &kernel_sysctl) return File{sysctl_path(thing.what), value};
  if (kind == &governor) return File{governor_path(thing.what), value};
  if (kind == &workqueues) return File{workqueues_path, mask_of_list(value)};
  if (kind == &threaded) return File{threaded_path(thing.title()), value};
  if (kind == &steering) return File{steering_path(thing.title()), mask_of_list(value)};
  return {};
}

std::string read_only(const Thing& thing) {
  const auto file =
      thing.kind == &interrupt ? File{interrupt_path(thing.what), ""} : file_of(thing, "").value_or(File{});
  if (access(file.path.c_str(), W_OK) == 0) return "";
  const bool is_denied = errno == EACCES && geteuid() == 0;  // to root of a user namespace
  if (errno != EROFS && !is_denied) return "";
  return fmt::format(
      "{} is read-only here, as in a container. Fix: docker run --privileged{}, or set it on the host",
      file.path, is_denied ? " as root" : "");
}

std::vector<int> online_cpus() {
  const auto list = read_file(fmt::format("{}/online", cpus_folder)).value_or("");
  return realtime::cpus_of(list).value_or(std::vector<int>{});
}

std::string missing_cpu(const std::string& cpus) {
  const auto there = online_cpus();
  for (const int cpu : realtime::cpus_of(cpus).value_or(std::vector<int>{}))
    if (std::ranges::find(there, cpu) == there.end())
      return fmt::format("there is no CPU {}; there are {}", cpu, realtime::list_of(there));
  return "";
}

std::vector<Thing> cpus_with_governor() {
  std::vector<Thing> found;
  for (const int number : online_cpus())
    if (const auto cpu = fmt::format("cpu{}", number); governor.read(cpu)) found.push_back({&governor, cpu});
  return found;
}

std::vector<Thing> receive_queues_of(const std::string& interface) {
  std::vector<Thing> found;
  for (const auto& queue : names_in(folder_of_interface(interface) + "/queues"))
    if (const auto what = interface_here(interface) + '/' + queue; is_queue(what) && steering.read(what))
      found.push_back({&steering, what});
  return found;
}

}  // namespace ontime::settings

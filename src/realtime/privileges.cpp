// SPDX-License-Identifier: Apache-2.0
#include "realtime/privileges.hpp"

#include <algorithm>
#include <charconv>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <sstream>
#include <string_view>
#include <system_error>
#include <utility>

#include <fmt/format.h>
#include <linux/capability.h>
#include <sys/resource.h>

#include "realtime/state.hpp"

namespace ontime::realtime {
namespace {

using namespace std::string_literals;

std::string path_of_program() {
  std::error_code ignored;
  const auto path = std::filesystem::read_symlink("/proc/self/exe", ignored).string();
  return path.empty() ? "ontime" : path;
}

bool is_in_set(const std::string& status, const char* set, int capability, const char* if_unknown) {
  const auto text = process::field(status, set).value_or(if_unknown);
  std::uint64_t mask = 0;
  std::from_chars(text.data(), text.data() + text.size(), mask, 16);
  return (mask >> capability & 1U) != 0;
}

}  // namespace

bool has_capability(const std::string& status, int capability) {
  return is_in_set(status, "CapEff", capability, "");
}

bool Privileges::is_of_first_namespace() const {
  std::istringstream map(uid_map);
  std::uint64_t first = 0, outside = 0, count = 0;
  return !(map >> first >> outside >> count) || count == std::numeric_limits<std::uint32_t>::max();
}

bool Privileges::is_root() const {
  std::istringstream users(process::field(status, "Uid").value_or(""));  // the real one, then the effective
  int real = -1, effective = -1;
  return users >> real >> effective && effective == 0;
}

bool Privileges::has(int capability) const {
  return is_of_first_namespace() && has_capability(status, capability);
}

bool Privileges::is_final_without(int capability) const {
  return !has(capability) && (is_root() || !is_of_first_namespace() ||
                              !is_in_set(status, "CapBnd", capability, "ffffffffffffffff"));
}

std::string Privileges::lack_of(const char* name) const {
  return fmt::format("no {}{}", name, is_of_first_namespace() ? "" : " outside this user namespace");
}

Privileges privileges() {
  return {process::text_of("/proc/thread-self/status").value_or(""),
          process::text_of("/proc/self/uid_map").value_or("")};
}

bool capable(int capability) { return has_capability(privileges().status, capability); }

std::string limit_of(int resource) {
  rlimit limit{};
  getrlimit(static_cast<__rlimit_resource>(resource), &limit);
  return limit.rlim_cur == RLIM_INFINITY ? "unlimited" : std::to_string(limit.rlim_cur);
}

std::string message_of(int error) { return std::generic_category().message(error); }

std::string how_to_permit_container(const Privileges& own) {
  constexpr const char* limits = "--ulimit rtprio=99 --ulimit memlock=-1";
  if (!own.is_of_first_namespace())
    return fmt::format(
        "in a user namespace, such as a rootless container's, only limits count: permit them to its user on "
        "the host (/etc/security/limits.d), and start it with docker run {}",
        limits);
  if (!own.is_final_without(CAP_SYS_NICE) && !own.is_final_without(CAP_IPC_LOCK)) return "";
  return fmt::format("let the container (or service) have it: docker run --cap-add SYS_NICE {}", limits);
}

std::string how_to_be_root_in_container(const Privileges& own) {
  std::string options;
  for (const auto& [capability, name] : {std::pair(CAP_SYS_ADMIN, "SYS_ADMIN"), {CAP_NET_ADMIN, "NET_ADMIN"}})
    if (own.is_final_without(capability)) options += fmt::format(" --cap-add {}", name);
  if (options.empty()) return "";
  const bool is_roots = own.is_root() && own.is_of_first_namespace();
  return fmt::format("let the container (or service) have it{}: docker run{} (or --privileged)",
                     is_roots ? "" : ", as root", options);
}

std::string how_to_permit_capabilities() {
  if (auto by_container = how_to_permit_container(privileges()); !by_container.empty()) return by_container;
  return fmt::format("run as root, or: sudo setcap cap_sys_nice,cap_ipc_lock+ep {}", path_of_program());
}

std::string service_of(const std::string& cgroup) {
  static constexpr std::string_view system = ":/system.slice/", ending = ".service";
  std::istringstream lines(cgroup);
  for (std::string line; std::getline(lines, line);) {
    const auto at = line.find(system);
    if (at == line.npos) continue;
    const auto end = line.find(std::string(ending) + "/", at);
    if (end == line.npos && !line.ends_with(ending)) continue;
    line.resize(end == line.npos ? line.size() : end + ending.size());
    return line.substr(line.rfind('/') + 1);
  }
  return "";
}

std::string how_to_permit_service(const std::string& environment, const std::string& cgroup, int priority) {
  // A login through a service such as sshd is in that service's group, but lacks systemd's variable.
  if (("\0"s + environment).find("\0INVOCATION_ID="s) == std::string::npos) return "";
  const auto service = service_of(cgroup);
  if (service.empty()) return "";
  return fmt::format(
      "sudo systemctl edit '{0}', add these lines, then sudo systemctl restart '{0}':\n"
      "[Service]\n"
      "LimitRTPRIO={1}\n"
      "LimitMEMLOCK=infinity",
      service, std::max(priority, 98));
}

std::string how_to_permit(int priority) {
  if (auto by_unit = how_to_permit_service(process::text_of("/proc/self/environ").value_or(""),
                                           process::text_of("/proc/self/cgroup").value_or(""), priority);
      !by_unit.empty())
    return by_unit;
  if (auto by_container = how_to_permit_container(privileges()); !by_container.empty()) return by_container;
  return fmt::format(
      "sudo groupadd --force realtime && sudo usermod --append --groups realtime $USER, add these lines to "
      "/etc/security/limits.d/realtime.conf and log in again:\n"
      "@realtime - rtprio {}\n"
      "@realtime - memlock unlimited\n"
      "or {}",
      std::max(priority, 98), how_to_permit_capabilities());
}

std::vector<std::string> budget_files(const std::string& cgroup) {
  std::vector<std::string> files;
  // A line is "3:cpu,cpuacct:/path"; inside a container the path may be one that only the host sees.
  std::istringstream lines(cgroup);
  for (std::string number, controllers, path; std::getline(lines, number, ':') &&
                                              std::getline(lines, controllers, ':') &&
                                              std::getline(lines, path);)
    if (("," + controllers + ",").find(",cpu,") != std::string::npos)
      for (const auto& group : {path, std::string("/")})
        files.push_back(fmt::format("/sys/fs/cgroup/{}{}/cpu.rt_runtime_us", controllers, group));
  return files;
}

bool throttles_real_time(const std::string& release, bool has_budget) {
  return has_budget || !is_kernel_since(6, 12, release);
}

std::string file_of_empty_realtime_budget() {
  for (const auto& file : budget_files(process::text_of("/proc/self/cgroup").value_or("")))
    if (const auto budget = process::number(process::text_of(file))) return budget == 0 ? file : "";
  return "";
}

}  // namespace ontime::realtime

// SPDX-License-Identifier: Apache-2.0
#include "realtime/privileges.hpp"

#include <algorithm>
#include <charconv>
#include <filesystem>
#include <sstream>
#include <string_view>
#include <system_error>

#include <fmt/format.h>
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

}  // namespace

bool has_capability(const std::string& status, int capability) {
  const auto effective = process::field(status, "CapEff").value_or("");
  std::uint64_t mask = 0;
  std::from_chars(effective.data(), effective.data() + effective.size(), mask, 16);
  return (mask >> capability & 1U) != 0;
}

bool capable(int capability) {
  return has_capability(process::text_of("/proc/thread-self/status").value_or(""), capability);
}

std::string limit_of(int resource) {
  rlimit limit{};
  getrlimit(static_cast<__rlimit_resource>(resource), &limit);
  return limit.rlim_cur == RLIM_INFINITY ? "unlimited" : std::to_string(limit.rlim_cur);
}

std::string message_of(int error) { return std::generic_category().message(error); }

std::string how_to_permit_capabilities() {
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

// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <filesystem>
#include <set>
#include <sstream>

#include <fmt/format.h>
#include <sys/resource.h>
#include <sys/utsname.h>
#include <unistd.h>

#include "json.hpp"
#include "machine/machine.hpp"
#include "machine/proc.hpp"

namespace ontime::machine {
namespace {

using nlohmann::json;

template <typename Value>
json or_null(const std::optional<Value>& value) {
  return value ? json(*value) : json(nullptr);
}

json limit(__rlimit_resource resource) {
  rlimit limit{};
  if (getrlimit(resource, &limit) != 0) return nullptr;
  return limit.rlim_cur == RLIM_INFINITY ? json("unlimited") : json(limit.rlim_cur);
}

std::optional<std::string> cpu_model() {
  auto model = field(text_of("/proc/cpuinfo").value_or(""), "model name");
  if (model) return model;
  auto board = text_of("/proc/device-tree/model");  // ARM boards; the text ends with a zero
  if (board) std::erase(*board, '\0');
  return word(board);
}

// One word if all CPUs have the same.
std::optional<std::string> governor() {
  std::set<std::string> governors;
  for (long cpu = 0; cpu < sysconf(_SC_NPROCESSORS_CONF); ++cpu) {
    const auto file = fmt::format("/sys/devices/system/cpu/cpu{}/cpufreq/scaling_governor", cpu);
    if (auto one = word(text_of(file))) governors.insert(*one);
  }
  if (governors.empty()) return {};
  return fmt::format("{}", fmt::join(governors, ", "));
}

// The smallest of a group's own limit and those of the groups around it; in a container, the outermost group
// that can be seen is its own.
json smallest_limit(const std::vector<std::string>& groups, const std::string& pattern) {
  constexpr std::int64_t no_limit = std::int64_t{1} << 62;  // and above: version 1 has no word for it
  std::optional<std::int64_t> smallest;
  for (const auto& group : groups) {
    const auto text = word(text_of(fmt::format(fmt::runtime(pattern), group)));
    const auto limit = text == "max" ? no_limit : number(text);
    if (limit) smallest = std::min(smallest.value_or(no_limit), *limit);
  }
  if (!smallest) return nullptr;
  return *smallest >= no_limit ? json("unlimited") : json(*smallest);
}

json cgroup_memory() {
  const auto own = text_of("/proc/self/cgroup").value_or("");
  auto first = smallest_limit(cgroups_of(own, "memory"), "/sys/fs/cgroup/memory{}/memory.limit_in_bytes");
  if (!first.is_null()) return first;
  const auto groups = cgroups_of(own, "");
  auto second = smallest_limit(groups, "/sys/fs/cgroup{}/memory.max");
  if (!second.is_null()) return second;
  // The root group has no such file: nothing limits what runs in it.
  const bool unlimited = groups.size() == 1 && std::filesystem::exists("/sys/fs/cgroup/cgroup.controllers");
  return unlimited ? json("unlimited") : json(nullptr);
}

json memory_bytes() {
  const long pages = sysconf(_SC_PHYS_PAGES), page_bytes = sysconf(_SC_PAGESIZE);
  return pages < 0 || page_bytes < 0 ? json(nullptr) : json(std::int64_t{pages} * page_bytes);
}

json virtual_machine() {
  const auto flags = field(text_of("/proc/cpuinfo").value_or(""), "flags");  // x86 only
  return flags ? json((" " + *flags + " ").find(" hypervisor ") != std::string::npos) : json(nullptr);
}

constexpr std::string_view simulated_word = "ontime.simulated=";

}  // namespace

std::string simulated_by(const std::string& what) { return fmt::format("\"{}{}\"", simulated_word, what); }

std::optional<std::string> simulated(const std::string& command_line) {
  const auto word = '"' + std::string(simulated_word);
  const auto begin = command_line.find(word);
  if (begin == command_line.npos) return {};
  const auto rest = command_line.substr(begin + word.size());
  return rest.substr(0, rest.find('"'));
}

json describe() {
  utsname kernel{};
  uname(&kernel);
  const auto command_line = word(text_of("/proc/cmdline"));
  const auto autogroup = number(text_of("/proc/sys/kernel/sched_autogroup_enabled"));
  const auto isolated = text_of("/sys/devices/system/cpu/isolated");
  const json description = {
      {"hostname", kernel.nodename},
      {"simulated", or_null(simulated(command_line.value_or("")))},
      {"kernel_release", kernel.release},
      {"kernel_version", kernel.version},
      {"kernel_command_line", or_null(command_line)},
      {"preemption",
       or_null(preemption(text_of("/sys/kernel/realtime"), text_of("/sys/kernel/debug/sched/preempt"),
                          command_line.value_or(""), kernel.version))},
      {"rt_runtime_us", or_null(number(text_of("/proc/sys/kernel/sched_rt_runtime_us")))},
      {"rt_period_us", or_null(number(text_of("/proc/sys/kernel/sched_rt_period_us")))},
      {"autogroup", autogroup ? json(*autogroup != 0) : json(nullptr)},
      {"boot_id", or_null(word(text_of("/proc/sys/kernel/random/boot_id")))},
      {"clock", clock_state()},
      {"cpu_model", or_null(cpu_model())},
      {"cpu_count", sysconf(_SC_NPROCESSORS_ONLN)},
      {"isolated_cpus", isolated ? json(word(isolated).value_or("")) : json(nullptr)},
      {"governor", or_null(governor())},
      {"clocksource",
       or_null(word(text_of("/sys/devices/system/clocksource/clocksource0/current_clocksource")))},
      {"virtual_machine", virtual_machine()},
      {"memory_bytes", memory_bytes()},
      {"limits",
       {{"rtprio", limit(RLIMIT_RTPRIO)},
        {"memlock_bytes", limit(RLIMIT_MEMLOCK)},
        {"cgroup_memory_bytes", cgroup_memory()}}}};
  // A command line or a name may hold bytes that are not UTF-8; JSON may not.
  return parsed_json(description.dump(-1, ' ', false, json::error_handler_t::replace));
}

std::optional<GroupMemory> group_memory() {
  const auto own = text_of("/proc/self/cgroup").value_or("");
  std::optional<GroupMemory> least;
  const auto look = [&](const std::string& folder, const char* limit_file, const char* usage_file) {
    const auto limit = number(text_of(folder + limit_file)), usage = number(text_of(folder + usage_file));
    if (!limit || !usage) return;  // "max"
    const auto used = static_cast<std::uint64_t>(*usage);
    const auto of_files = parse_file_pages(text_of(folder + "memory.stat").value_or(""));
    const GroupMemory group{static_cast<std::uint64_t>(*limit), used - std::min(used, of_files)};
    if (!least || group.left_bytes() < least->left_bytes()) least = group;
  };
  for (const auto& group : cgroups_of(own, "memory"))
    look(fmt::format("/sys/fs/cgroup/memory{}/", group), "memory.limit_in_bytes", "memory.usage_in_bytes");
  for (const auto& group : cgroups_of(own, ""))
    look(fmt::format("/sys/fs/cgroup{}/", group), "memory.max", "memory.current");
  return least;
}

std::vector<GroupQuota> cpu_quotas(const std::string& root) {
  const auto own = text_of(root + "/proc/self/cgroup").value_or("");
  std::vector<GroupQuota> quotas;
  const auto look = [&](const std::string& folder, const char* file, const std::string& limit) {
    std::istringstream words(limit);
    std::int64_t quota_us = 0, period_us = 0;
    words >> quota_us >> period_us;
    if (quota_us <= 0 || period_us <= 0) return;  // "max", "-1"
    quotas.push_back({folder + file, static_cast<double>(quota_us) / static_cast<double>(period_us)});
    parse_throttled(text_of(root + folder + "cpu.stat").value_or(""), quotas.back());
  };
  const auto text = [&](const std::string& file) { return text_of(root + file).value_or(""); };
  for (const auto& group : cgroups_of(own, "cpu")) {
    const auto folder = fmt::format("/sys/fs/cgroup/cpu{}/", group);
    look(folder, "cpu.cfs_quota_us",
         text(folder + "cpu.cfs_quota_us") + ' ' + text(folder + "cpu.cfs_period_us"));
  }
  for (const auto& group : cgroups_of(own, "")) {
    const auto folder = fmt::format("/sys/fs/cgroup{}/", group);
    look(folder, "cpu.max", text(folder + "cpu.max"));
  }
  return quotas;
}

std::optional<GroupQuota> between(const std::vector<GroupQuota>& first, const std::vector<GroupQuota>& last) {
  std::optional<GroupQuota> most;
  for (auto now : last) {
    const auto before = std::ranges::find(first, now.file, &GroupQuota::file);
    if (before == first.end() || now.throttled_ns <= before->throttled_ns ||
        now.throttled_periods < before->throttled_periods)
      continue;
    now.throttled_ns -= before->throttled_ns;
    now.throttled_periods -= before->throttled_periods;
    if (!most || now.throttled_ns > most->throttled_ns) most = now;
  }
  return most;
}

std::vector<std::string> shared_memory() { return parse_segments(text_of("/proc/self/maps").value_or("")); }

}  // namespace ontime::machine

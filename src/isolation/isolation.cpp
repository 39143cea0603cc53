// SPDX-License-Identifier: Apache-2.0
#include "isolation/isolation.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iterator>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sys/utsname.h>
#include <unistd.h>

#include "isolation/groups.hpp"
#include "realtime/realtime.hpp"
#include "settings/file.hpp"

namespace ontime::isolation {
namespace {

using journal::Error;
using settings::read_file;
using settings::write_file;
using Cpus = std::vector<int>;

const std::string robot = "cpuset/ontime-robot", others = "cpuset/ontime-rest", load = "cpu/ontime-load";
constexpr int period_us = 100'000;  // of a quota, as the kernel has it
constexpr std::size_t named = 5;    // of a list for people

Cpus list(const std::string& text) { return realtime::cpus_of(text).value_or(Cpus{}); }

bool has(const Cpus& cpus, int cpu) { return std::ranges::count(cpus, cpu) > 0; }
bool any_of(const Cpus& cpus, const Cpus& these) {
  return std::ranges::find_first_of(cpus, these) != cpus.end();
}
Cpus without(Cpus cpus, const Cpus& these) {
  std::erase_if(cpus, [&](int cpu) { return has(these, cpu); });
  return cpus;
}

std::string some_of(const std::vector<std::string>& names) {
  const auto end = names.begin() + static_cast<std::ptrdiff_t>(std::min(names.size(), named));
  return fmt::format("{}{}", fmt::join(names.begin(), end, ", "),
                     names.size() > named ? fmt::format(" and {} more", names.size() - named) : "");
}

// The text of a kernel file; "gone" if it does not exist.
std::string said(const std::string& file) { return read_file(file).value_or("gone"); }

// The CPUs that a group actually has.
std::string cpus_in(const std::string& folder, bool unified) {
  return said(folder + (unified ? "/cpuset.cpus.effective" : "/cpuset.cpus"));
}

void check_spare(const std::string& asked, const Cpus& kept, const std::string& everybodys) {
  const auto online = said("/sys/devices/system/cpu/online");
  for (const int cpu : kept) {
    if (!has(list(online), cpu))
      throw Error(fmt::format("no CPU {} on this machine; online: {}", cpu, online));
    if (!has(list(everybodys), cpu))
      throw Error(fmt::format("CPU {} is already reserved: of CPUs {} all processes have {}", cpu, online,
                              everybodys));
  }
  if (without(list(everybodys), kept).empty())
    throw Error(
        fmt::format("CPUs {} are all CPUs. Fix: leave at least one CPU to the other processes", asked));
}

// All processes inherit the CPUs of the first one. If these are not all CPUs, as with isolcpus, cgroup v1
// would move no process.
void check_inherited(const std::string& asked, const Cpus& kept, const std::string& everybodys) {
  const auto inherited = cpus_of_thread(1);
  const auto nobodys = without(list(everybodys), inherited);
  if (nobodys.empty() || !any_of(inherited, kept)) return;
  throw Error(fmt::format(
      "CPUs {} cannot be reserved: all processes are bound to {} of {} since boot (isolcpus= on the kernel's "
      "command line, or systemd's CPUAffinity=), and cgroup v1 does not move bound processes. Fix: reserve "
      "CPUs {}, or use cgroup v2",
      asked, realtime::list_of(inherited), everybodys, realtime::list_of(nobodys)));
}

void check_nothing_is_forgotten(const std::string& everybodys, const Cpus& kept) {
  utsname name{};
  uname(&name);
  const bool remembers = realtime::is_kernel_since(6, 2, name.release);
  const auto all = list(everybodys);
  std::vector<std::string> own;
  for (const auto& thread : threads())
    if (would_be_forgotten(thread, all, kept, remembers))
      own.push_back(fmt::format("{} ({})", thread.name, thread.id));
  if (!own.empty())
    throw Error(fmt::format(
        "threads are bound to CPUs, {}: {}. Fix: release them during the run (taskset --all-tasks "
        "--cpu-list --pid {} PID), or reserve other CPUs",
        remembers ? "and would be moved away from them" : "which Linux before 6.2 would forget", some_of(own),
        everybodys));
}

// The process reports its own id, which is another process's id here if it runs in its own PID namespace.
void check_is_ours(pid_t process) {
  namespace fs = std::filesystem;
  for (const auto* link : {"exe", "ns/pid"}) {
    std::error_code ended;
    const auto here = fs::read_symlink(fmt::format("/proc/self/{}", link), ended);
    const auto there = fs::read_symlink(fmt::format("/proc/{}/{}", process, link), ended);
    if (process <= 1 || ended || here != there)
      throw Error(
          fmt::format("process {} is not the agent that needs the reserved CPUs: another program, or in its "
                      "own PID namespace",
                      process));
  }
}

}  // namespace

Isolation::Isolation(journal::Journal& journal, const Wish& wish) : journal_(journal), wish_(wish) {
  if (geteuid() != 0) throw Error("needs root. Fix: run as root");
  try {
    if (!wish_.cpus.empty()) keep_cpus();
    if (wish_.limits()) limit();
  } catch (const std::exception&) {
    take_back();
    throw;
  }
}

Isolation::~Isolation() {
  try {
    take_back();
  } catch (const std::exception&) {  // it is in the journal
    return;
  }
}

std::vector<std::string> Isolation::take_back() {
  std::vector<std::string> left;
  for (; !made_.empty(); made_.pop_back()) {
    const auto lines = journal_.take_back(*made_.back().kind, made_.back().what);
    left.insert(left.end(), lines.begin(), lines.end());
  }
  return left;
}

void Isolation::make(const journal::Kind& kind, const std::string& what, const journal::Value& wanted) {
  made_.push_back({&kind, what});
  journal_.change(kind, what, wanted);
}

void Isolation::keep_cpus() {
  const auto root = hierarchy_of("cpuset");
  const auto kept = list(wish_.cpus);
  everybodys_ = cpus_in(root.folder, root.unified);
  check_spare(wish_.cpus, kept, everybodys_);
  rest_ = realtime::list_of(without(list(everybodys_), kept));
  if (const auto owners = owners_of(root, kept); !owners.empty())
    throw Error(
        fmt::format("CPUs {} belong to other control groups: {}. Fix: reserve other CPUs, or remove them "
                    "there (systemd service: AllowedCPUs=)",
                    wish_.cpus, some_of(owners)));
  if (root.unified) {
    check_nothing_is_forgotten(everybodys_, kept);
    if (!controller_kind.read("cpuset").value_or("").starts_with("on")) make(controller_kind, "cpuset", "on");
    make(group_kind, robot, journal::to_be_made);
    const auto folder = folder_of(robot);
    write_file(folder + "/cpuset.cpus", wish_.cpus);
    const auto partition = folder + "/cpuset.cpus.partition";
    if (!read_file(partition)) throw Error("this kernel has no CPU partitions (needs Linux 5.0)");
    write_file(partition, "root");
    if (said(partition) != "root")
      throw Error(fmt::format("the kernel refuses a partition of CPUs {}: {}", wish_.cpus, said(partition)));
    return;
  }
  check_inherited(wish_.cpus, kept, everybodys_);
  for (const auto& [group, cpus] : {std::pair(robot, wish_.cpus), std::pair(others, rest_)}) {
    make(group_kind, group, journal::to_be_made);
    write_file(folder_of(group) + "/cpuset.mems", said(root.folder + "/cpuset.mems"));
    write_file(folder_of(group) + "/cpuset.cpus", cpus);
  }
  write_file(folder_of(robot) + "/cpuset.cpu_exclusive", "1");
  move_others();
  make(balance_kind, "root", "0");
}

// Repeated until no process has forked in between.
void Isolation::move_others() const {
  constexpr int tries = 100;
  const auto root = hierarchy_of("cpuset").folder, folder = folder_of(others);
  const auto all = list(everybodys_);
  for (int i = 0; i < tries; ++i) {
    bool moved = false;
    for (const auto id : ids_in(root + "/tasks"))
      moved = (cpus_of_thread(id) == all && move(id, folder + "/tasks")) || moved;
    if (!moved) return;
  }
}

void Isolation::limit() {
  const auto root = hierarchy_of("cpu");
  if (root.unified && !controller_kind.read("cpu").value_or("").starts_with("on"))
    make(controller_kind, "cpu", "on");
  make(group_kind, load, journal::to_be_made);
  const auto set = [&](const char* setting, const char* file, const std::string& value) {
    const auto path = fmt::format("{}/{}", folder_of(load), file);
    const auto before = read_file(path);
    if (!before) throw Error(fmt::format("isolation.{}: this kernel has no {}", setting, file));
    write_file(path, value);
    limits_.push_back({setting, file, *before, said(path), ""});
  };
  const auto quota_us = std::lround(wish_.load_quota * period_us);
  const auto shares = std::max(2L, std::lround(wish_.load_weight * 10.24));  // the default is 1024
  if (wish_.load_quota > 0 && root.unified)
    set("load-quota", "cpu.max", fmt::format("{} {}", quota_us, period_us));
  else if (wish_.load_quota > 0)
    set("load-quota", "cpu.cfs_quota_us", std::to_string(quota_us));
  if (wish_.load_weight > 0 && root.unified)
    set("load-weight", "cpu.weight", std::to_string(wish_.load_weight));
  else if (wish_.load_weight > 0)
    set("load-weight", "cpu.shares", std::to_string(shares));
}

void Isolation::keep(pid_t process) const {
  if (wish_.cpus.empty()) return;
  check_is_ours(process);
  if (!move(process, folder_of(robot) + "/cgroup.procs"))
    throw Error(fmt::format("cannot give CPUs {} to process {}: it has ended", wish_.cpus, process));
  if (const auto cpus = cpus_of_thread(process); !without(cpus, list(wish_.cpus)).empty())
    throw Error(
        fmt::format("process {}: requested CPUs {}, has {}", process, wish_.cpus, realtime::list_of(cpus)));
}

std::vector<std::string> Isolation::beside() const {
  std::vector<std::string> files;
  if (!wish_.cpus.empty() && !hierarchy_of("cpuset").unified)
    files.push_back(folder_of(others) + "/cgroup.procs");
  if (wish_.limits()) files.push_back(folder_of(load) + "/cgroup.procs");
  return files;
}

std::vector<Isolation::State> Isolation::state() const {
  std::vector<State> all;
  if (!wish_.cpus.empty()) {
    const auto root = hierarchy_of("cpuset");
    auto kept = cpus_in(folder_of(robot), root.unified);
    if (const auto partition = root.unified ? said(folder_of(robot) + "/cpuset.cpus.partition") : "root";
        partition != "root")
      kept += ", partition: " + partition;
    const auto rests = root.unified ? cpus_in(root.folder, true) : cpus_in(folder_of(others), false);
    all.push_back({"cpus", "the robot", "none", realtime::list_of(list(wish_.cpus)), kept});
    all.push_back({"cpus", "all other processes", everybodys_, rest_, rests});
  }
  for (auto limit : limits_) {
    limit.now = said(fmt::format("{}/{}", folder_of(load), limit.thing));
    all.push_back(std::move(limit));
  }
  return all;
}

std::string Isolation::stay() const {
  if (wish_.cpus.empty()) return "";
  std::vector<std::string> names;
  const auto kept = list(wish_.cpus);
  const auto ours =
      ids_in(folder_of(robot) + (hierarchy_of("cpuset").unified ? "/cgroup.threads" : "/tasks"));
  auto all = threads();
  std::stable_partition(all.begin(), all.end(), [](const Thread& one) { return !one.of_kernel; });
  for (const auto& thread : all)
    // kthreadd only creates the kernel's other threads.
    if (!(thread.of_kernel && (thread.bound || thread.name == "kthreadd")) && any_of(thread.cpus, kept) &&
        std::ranges::count(ours, thread.id) == 0)
      names.push_back(
          fmt::format("{} ({}, CPUs {})", thread.name, thread.id, realtime::list_of(thread.cpus)));
  return some_of(names);
}

}  // namespace ontime::isolation

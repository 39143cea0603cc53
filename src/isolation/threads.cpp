// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cerrno>
#include <fstream>
#include <iterator>

#include <fcntl.h>
#include <fmt/format.h>
#include <sched.h>
#include <unistd.h>

#include "isolation/groups.hpp"
#include "number.hpp"
#include "process/process.hpp"
#include "settings/file.hpp"

namespace ontime::isolation {
namespace {

// From a thread's stat; nullopt: it has ended.
std::optional<Thread> thread_of(const std::string& folder, pid_t id) {
  constexpr unsigned long no_setaffinity = 0x0400'0000;
  const auto text = settings::read_file(folder + "/stat");
  const auto stat = text ? process::parse_stat(*text) : std::nullopt;
  auto cpus = cpus_of_thread(id);
  if (!stat || stat->has_ended() || cpus.empty()) return {};
  return Thread{id, stat->name, std::move(cpus), stat->is_of_kernel(), (stat->flags & no_setaffinity) != 0};
}

}  // namespace

std::vector<int> cpus_of_thread(pid_t id) {
  cpu_set_t set;
  CPU_ZERO(&set);
  std::vector<int> cpus;
  if (sched_getaffinity(id, sizeof set, &set) != 0) return cpus;
  for (int cpu = 0; cpu < CPU_SETSIZE; ++cpu)
    if (CPU_ISSET(static_cast<unsigned>(cpu), &set)) cpus.push_back(cpu);
  return cpus;
}

void set_cpus(pid_t id, const std::vector<int>& cpus) {
  cpu_set_t set;
  CPU_ZERO(&set);
  for (const int cpu : cpus) CPU_SET(static_cast<unsigned>(cpu), &set);
  sched_setaffinity(id, sizeof set, &set);
}

std::vector<Thread> threads() {
  std::vector<Thread> all;
  for (const auto& process : settings::names_in("/proc")) {
    if (!number_in<pid_t>(process)) continue;
    const auto tasks = fmt::format("/proc/{}/task", process);
    for (const auto& id : settings::names_in(tasks)) try {
        if (auto thread = thread_of(fmt::format("{}/{}", tasks, id), std::stoi(id)))
          all.push_back(std::move(*thread));
      } catch (const journal::Error&) {  // it ended while it was read
        continue;
      }
  }
  return all;
}

// When a partition is made and removed, the kernel gives all threads of the root group the root's CPUs.
// Before Linux 6.2 it forgets the CPUs that they had requested, and those of its own threads always (except
// interrupt threads, which are set again: see remove_group). A thread that requested only reserved CPUs has
// to move.
bool would_be_forgotten(const Thread& thread, const std::vector<int>& everybodys,
                        const std::vector<int>& kept, bool remembers) {
  if (thread.of_kernel && (thread.bound || thread.name.starts_with("irq/"))) return false;
  if (thread.of_kernel || !remembers) return thread.cpus != everybodys;
  return std::ranges::all_of(thread.cpus, [&](int cpu) { return std::ranges::count(kept, cpu) > 0; });
}

std::vector<pid_t> ids_in(const std::string& path) {
  std::ifstream file(path);
  std::vector<pid_t> ids(std::istream_iterator<pid_t>(file), {});
  if (std::ranges::count(ids, 0) > 0)  // the kernel's word for a process outside our PID namespace
    throw journal::Error(path + " has processes of another PID namespace. Fix: run on the machine itself");
  return ids;
}

bool move(pid_t id, const std::string& file) {
  const auto text = std::to_string(id);
  const process::Fd fd(open(file.c_str(), O_WRONLY | O_CLOEXEC));
  if (fd.get() < 0) throw settings::trouble(file, errno);
  if (write(fd.get(), text.data(), text.size()) >= 0) return true;
  if (errno == ESRCH || errno == EINVAL) return false;  // EINVAL: a bound kernel thread
  throw settings::trouble(fmt::format("process {} into {}", id, file), errno);
}

}  // namespace ontime::isolation

// SPDX-License-Identifier: Apache-2.0
// Threads of the kernel: their policy, priority and CPUs.
#include <algorithm>
#include <cerrno>
#include <iterator>
#include <sstream>

#include <fmt/format.h>
#include <sched.h>
#include <sys/resource.h>

#include "number.hpp"
#include "process/process.hpp"
#include "realtime/realtime.hpp"
#include "settings/file.hpp"
#include "settings/kinds.hpp"

namespace ontime::settings {
namespace {

struct Policy {
  const char* name;
  int kernel;
  bool has_priority;
};
constexpr Policy policies[] = {{"other", SCHED_OTHER, false},
                               {"fifo", SCHED_FIFO, true},
                               {"rr", SCHED_RR, true},
                               {"batch", SCHED_BATCH, false},
                               {"idle", SCHED_IDLE, false}};

struct Scheduling {
  const Policy* policy;
  int number;  // priority or niceness
  std::optional<std::string> cpus;
};

Scheduling parse(const std::string& text) {
  std::istringstream parts(text);
  std::string policy, number, cpus;
  std::getline(parts, policy, ':') && std::getline(parts, number, ':');
  const bool says_cpus = !parts.eof();
  std::getline(parts, cpus);
  const auto* const known = std::ranges::find(policies, policy, &Policy::name);
  const auto value = number_in<int>(number);
  if (known == std::end(policies) || !value || (says_cpus && !realtime::cpus_of(cpus)))
    throw journal::Error(fmt::format("'{}' is not a thread state that can be restored", text));
  return {known, *value, says_cpus ? std::optional(cpus) : std::nullopt};
}

std::string text_of(const Scheduling& value) {
  const auto priority = fmt::format("{}:{}", value.policy->name, value.number);
  return value.cpus ? fmt::format("{}:{}", priority, *value.cpus) : priority;
}

// "PID:START:NAME" of a kernel thread; nothing if none has this id.
std::optional<std::string> identity_of(const std::string& pid) {
  const auto text = read_file(fmt::format("/proc/{}/stat", pid));
  const auto stat = text ? process::parse_stat(*text) : std::nullopt;
  if (!stat || !stat->is_of_kernel()) return {};
  return fmt::format("{}:{}:{}", pid, stat->start_ticks, stat->name);
}

// A container may have other thread ids and show no kernel threads: an invisible thread may still exist.
void check_kernel_is_seen() {
  const auto second = identity_of("2");
  if (!second || name_of_thread(*second) != "kthreadd")
    throw journal::Error("the kernel's threads are not visible here (in a container?)");
}

// Also threads whose priority alone is set: older journals hold them as this kind.
bool accepts(const std::string& what) {
  const auto first = what.find(':'), second = what.find(':', first + 1);
  if (second == what.npos) return false;
  const auto digits = [](std::string_view text) {
    return !text.empty() &&
           std::all_of(text.begin(), text.end(), [](char c) { return c >= '0' && c <= '9'; });
  };
  const auto name = what.substr(second + 1);
  return digits(what.substr(0, first)) && digits(what.substr(first + 1, second - first - 1)) &&
         (name.starts_with("ksoftirqd/") || name.starts_with("irq/") || name.starts_with("napi/"));
}

bool accepts_priority(const std::string& what) {
  const auto name = name_of_thread(what);
  return accepts(what) && (name.starts_with("ksoftirqd/") || name.starts_with("irq/"));
}

pid_t pid_of(const std::string& what) { return number_in<int>(what.substr(0, what.find(':'))).value_or(-1); }

bool is_there(const std::string& what) { return identity_of(what.substr(0, what.find(':'))) == what; }

journal::Value read(const std::string& what) {
  check_kernel_is_seen();
  if (!is_there(what)) return {};
  const auto pid = pid_of(what);
  const int policy = sched_getscheduler(pid) & ~SCHED_RESET_ON_FORK;
  sched_param parameters{};
  cpu_set_t set;
  errno = 0;
  const int niceness = getpriority(PRIO_PROCESS, static_cast<id_t>(pid));
  if (errno != 0 || sched_getparam(pid, &parameters) != 0 || sched_getaffinity(pid, sizeof set, &set) != 0) {
    if (errno == ESRCH) return {};
    throw trouble("thread " + what, errno);
  }
  std::vector<int> cpus;
  for (int cpu = 0; cpu < CPU_SETSIZE; ++cpu)
    if (CPU_ISSET(static_cast<unsigned>(cpu), &set)) cpus.push_back(cpu);
  const auto* const known = std::ranges::find(policies, policy, &Policy::kernel);
  if (known == std::end(policies)) return fmt::format("policy {}:0:{}", policy, realtime::list_of(cpus));
  return text_of(
      {known, known->has_priority ? parameters.sched_priority : niceness, realtime::list_of(cpus)});
}

journal::Value read_priority(const std::string& what) {
  auto value = read(what);
  if (value) value->erase(value->rfind(':'));
  return value;
}

void write(const std::string& what, const journal::Value& value, const journal::Value& present) {
  const auto pid = pid_of(what);
  const auto wanted = parse(value.value_or("")), before = parse(present.value_or(""));
  if (!is_there(what)) throw trouble("thread " + what, ESRCH);
  // Threads bound to their CPU refuse even their current CPUs.
  if (wanted.cpus != before.cpus) {
    cpu_set_t set;
    CPU_ZERO(&set);
    for (const int cpu : realtime::cpus_of(wanted.cpus.value_or("")).value_or(std::vector<int>{}))
      CPU_SET(static_cast<unsigned>(cpu), &set);
    if (sched_setaffinity(pid, sizeof set, &set) != 0)
      throw trouble(fmt::format("CPUs {} for thread {}", wanted.cpus.value_or(""), name_of_thread(what)),
                    errno);
  }
  const sched_param parameters{wanted.policy->has_priority ? wanted.number : 0};
  const bool done =
      sched_setscheduler(pid, wanted.policy->kernel, &parameters) == 0 &&
      (wanted.policy->has_priority || setpriority(PRIO_PROCESS, static_cast<id_t>(pid), wanted.number) == 0);
  if (!done) throw trouble(fmt::format("{} for thread {}", *value, name_of_thread(what)), errno);
}

// The number may be another one's later.
std::string title_of_thread(const std::string& what) {
  return fmt::format("{} [{}]", name_of_thread(what), pid_of(what));
}

}  // namespace

const journal::Kind thread = {.name = "thread",
                              .scope = journal::Scope::machine,
                              .accepts = accepts,
                              .read = read,
                              .write = write,
                              .title = title_of_thread};
const journal::Kind thread_priority = {.name = "thread priority",
                                       .scope = journal::Scope::machine,
                                       .accepts = accepts_priority,
                                       .read = read_priority,
                                       .write = write,
                                       .title = title_of_thread};

std::string name_of_thread(const std::string& what) {
  return what.substr(std::min(what.size(), what.find(':', what.find(':') + 1) + 1));
}

std::vector<Thing> threads_named(const std::string& prefix) {
  check_kernel_is_seen();
  std::vector<Thing> found;
  for (const auto& pid : names_in("/proc")) {
    if (!number_in<int>(pid)) continue;
    const auto identity = identity_of(pid);
    if (identity && name_of_thread(*identity).starts_with(prefix))
      found.push_back({accepts_priority(*identity) ? &thread_priority : &thread, *identity});
  }
  std::ranges::sort(found, {}, [](const Thing& one) { return name_of_thread(one.what); });
  return found;
}

std::string with_priority(const std::string& value, const std::string& asked) {
  auto state = parse(value);
  if (asked == "other" && !state.policy->has_priority) return value;
  state.policy = asked == "other" ? &policies[0] : &policies[1];
  state.number = asked == "other" ? 0 : number_in<int>(asked).value_or(0);
  return text_of(state);
}

std::string with_cpus(const std::string& value, const std::string& cpus) {
  auto state = parse(value);
  state.cpus = cpus;
  return text_of(state);
}

}  // namespace ontime::settings

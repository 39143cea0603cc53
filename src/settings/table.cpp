// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <map>
#include <optional>
#include <sstream>

#include <fmt/format.h>

#include "number.hpp"
#include "realtime/realtime.hpp"
#include "settings/file.hpp"
#include "settings/kinds.hpp"

namespace ontime::settings {
namespace {

using Text = const std::string&;
using Things = std::vector<Thing>;

std::optional<std::int64_t> number_of(Text text, std::int64_t least, std::int64_t most) {
  const auto number = number_in<std::int64_t>(text);
  return number && *number >= least && *number <= most ? number : std::nullopt;
}
std::string number_stated(Text text, std::int64_t least, std::int64_t most) {
  const auto number = number_of(text, least, most);
  if (!number)
    throw std::invalid_argument(fmt::format("'{}' is not a whole number from {} to {}", text, least, most));
  return std::to_string(*number);
}

std::string switch_stated(Text asked) {
  if (asked != "on" && asked != "off")
    throw std::invalid_argument(fmt::format("'{}' is not on or off", asked));
  return asked;
}
bool is_priority(Text asked) { return asked == "other" || number_of(asked, 1, 99); }
std::string priority_stated(Text asked) {
  if (!is_priority(asked))
    throw std::invalid_argument(fmt::format("'{}' is neither a priority from 1 to 99 nor other", asked));
  return asked == "other" ? asked : number_stated(asked, 1, 99);
}
std::string cpus_stated(Text asked) {
  const auto cpus = realtime::cpus_of(asked);
  if (!cpus)
    throw std::invalid_argument(fmt::format("'{}' is not a list of CPUs, such as 1 or 0-1,3", asked));
  return realtime::list_of(*cpus);
}
std::string cpus_or_none_stated(Text asked) { return asked == "none" ? asked : cpus_stated(asked); }
// The kernel refuses buffers below SOCK_MIN_SNDBUF (net/sock.h).
std::string bytes_stated(Text asked) {
  constexpr std::int64_t least = 4608, most = 2147483647;
  if (!number_of(asked, least, most))
    throw std::invalid_argument(fmt::format("{} B is not a size from {} B to {} B", asked, least, most));
  return number_stated(asked, least, most);
}
std::string us_stated(Text asked) { return number_stated(asked, 0, 1'000'000); }
std::string coalescing_stated(Text asked) {
  if (asked.empty()) throw std::invalid_argument("the value is empty; state NAME=N,..., such as rx-usecs=0");
  std::istringstream parts(with_coalescing("", asked));
  std::string stated;
  for (std::string part; std::getline(parts, part, ',');)
    if (const auto name = part.substr(0, part.find('=') + 1); ("," + asked).find("," + name) != asked.npos)
      stated += (stated.empty() ? "" : ",") + part;
  return stated;
}
std::string governor_stated(Text asked) {
  const auto plain = [](char c) { return (c >= 'a' && c <= 'z') || c == '_'; };
  if (asked.empty() || !std::all_of(asked.begin(), asked.end(), plain))
    throw std::invalid_argument(fmt::format("'{}' is not a governor, such as performance", asked));
  return asked;
}

// The part for this CPU of "60" or "0=60,1=other"; "": none.
std::string priority_of_cpu(Text asked, int cpu) {
  if (asked.find('=') == asked.npos) return asked;
  std::istringstream parts(asked);
  for (std::string part; std::getline(parts, part, ',');)
    if (const auto equals = part.find('='); std::stoi(part) == cpu) return part.substr(equals + 1);
  return "";
}
std::string priorities_stated(Text asked) {
  if (is_priority(asked)) return priority_stated(asked);
  if (asked.find('=') == asked.npos)
    throw std::invalid_argument(fmt::format(
        "'{}' is not a priority from 1 to 99, other, or a list for each CPU, such as 0=60,1=other", asked));
  std::istringstream parts(asked + ',');  // so that nothing behind the last comma is a part, too
  std::map<int, std::string> of_cpus;
  for (std::string part; std::getline(parts, part, ',');) {
    const auto equals = part.find('=');
    if (equals == part.npos)
      throw std::invalid_argument(
          fmt::format("'{}' is not CPU=PRIORITY; state a priority for each CPU, such as 0=60,1=other", part));
    const int cpu = std::stoi(number_stated(part.substr(0, equals), 0, 1023));
    if (!of_cpus.emplace(cpu, priority_stated(part.substr(equals + 1))).second)
      throw std::invalid_argument(fmt::format("'{}' names CPU {} twice", asked, part.substr(0, equals)));
  }
  std::string stated;
  for (const auto& [cpu, priority] : of_cpus)
    stated += fmt::format("{}{}={}", stated.empty() ? "" : ",", cpu, priority);
  return stated;
}

void check_online(Text cpus) {
  if (const auto missing = missing_cpu(cpus); !missing.empty()) throw Unknown(missing);
}

// ── The new value of a thing

std::string as_asked(Text asked, const Thing&, Text) { return asked; }
std::string one_or_zero(Text asked, const Thing&, Text) { return asked == "on" ? "1" : "0"; }
// The kernel refuses a runtime above its period.
std::string throttling(Text asked, const Thing&, Text) {
  if (asked == "off") return "-1";
  const auto period = number_in<std::int64_t>(read_file("/proc/sys/kernel/sched_rt_period_us").value_or(""));
  return std::to_string(period.value_or(1'000'000) * 95 / 100);
}
std::string these_cpus(Text asked, const Thing&, Text) {
  if (asked != "none") check_online(asked);
  return asked == "none" ? asked : realtime::list_of(*realtime::cpus_of(asked));
}
std::string with_this_priority(Text asked, const Thing&, Text now) { return with_priority(now, asked); }
std::string with_these_cpus(Text asked, const Thing& thing, Text now) {
  return with_cpus(now, these_cpus(asked, thing, now));
}
std::string with_priority_of_its_cpu(Text asked, const Thing& thing, Text now) {
  std::istringstream parts(asked);
  for (std::string part; std::getline(parts, part, ',');)
    if (const auto equals = part.find('='); equals != part.npos) check_online(part.substr(0, equals));
  const int cpu = std::stoi(thing.title().substr(thing.title().find('/') + 1));
  const auto own = priority_of_cpu(asked, cpu);
  return own.empty() ? "" : with_priority(now, own);
}
std::string with_this_coalescing(Text asked, const Thing&, Text now) { return with_coalescing(now, asked); }
std::string a_governor_there_is(Text asked, const Thing& thing, Text) {
  const auto there =
      read_file(fmt::format("/sys/devices/system/cpu/{}/cpufreq/scaling_available_governors", thing.what))
          .value_or("");
  if ((" " + there + " ").find(" " + asked + " ") == there.npos)
    throw journal::Error(fmt::format("{} has no governor '{}'; available: {}", thing.what, asked, there));
  return asked;
}

// ── The things that a setting changes

template <const journal::Kind& kind>
Things file_of_kernel(const char* name, const char* option) {
  if (!kind.read(name))
    throw journal::Error(fmt::format("this kernel has no /proc/sys/{} ({})", name, option));
  return {{&kind, name}};
}
Things throttled(Text) {
  return file_of_kernel<kernel_sysctl>("kernel/sched_rt_runtime_us", "no real-time throttling");
}
Things timers(Text) { return file_of_kernel<kernel_sysctl>("kernel/timer_migration", "CONFIG_NO_HZ_COMMON"); }

constexpr const char* not_here = "or only in another network namespace";
Things busy_poll(Text) { return file_of_kernel<network_sysctl>("net/core/busy_poll", not_here); }
Things busy_read(Text) { return file_of_kernel<network_sysctl>("net/core/busy_read", not_here); }
Things rmem_max(Text) { return file_of_kernel<network_sysctl>("net/core/rmem_max", not_here); }
Things rmem_default(Text) { return file_of_kernel<network_sysctl>("net/core/rmem_default", not_here); }
Things wmem_max(Text) { return file_of_kernel<network_sysctl>("net/core/wmem_max", not_here); }
Things wmem_default(Text) { return file_of_kernel<network_sysctl>("net/core/wmem_default", not_here); }

Things governors(Text) {
  auto found = cpus_with_governor();
  if (found.empty())
    throw journal::Error(
        "Linux does not control this machine's CPU frequency (virtual machine, or firmware control)");
  return found;
}

Things unbound_work(Text) {
  if (!workqueues.read("unbound"))
    throw journal::Error("this kernel cannot set the CPUs of its unbound work (needs Linux 4.2)");
  return {{&workqueues, "unbound"}};
}

Things softirqs(Text) {
  auto found = threads_named("ksoftirqd/");
  std::erase_if(found, [online = online_cpus()](const Thing& one) {
    return std::ranges::none_of(online,
                                [&](int cpu) { return one.title() == fmt::format("ksoftirqd/{}", cpu); });
  });
  if (found.empty()) throw journal::Error("this kernel has no ksoftirqd");
  return found;
}

Things of_driver(const journal::Kind& kind, Text interface, const char* lacks) {
  const auto what = interface_here(interface);
  if (!kind.read(what)) throw journal::Error(fmt::format("{} {}", interface, lacks));
  return {{&kind, what}};
}

void refuse_bridge(Text interface) {
  if (read_file(folder_of_interface(interface) + "/bridge/bridge_id"))
    throw journal::Error(fmt::format(
        "{0} is a bridge, which receives no packets itself. Fix: name one of its ports (bridge link)",
        interface));
}

Things offloaded(Text interface) {
  refuse_bridge(interface);
  return of_driver(gro, interface, "has no generic receive offload (GRO)");
}
Things coalesced(Text interface) {
  return of_driver(coalescing, interface, "has no interrupts to be coalesced");
}

Things steered(Text interface) {
  auto found = receive_queues_of(interface);
  if (found.empty())
    throw journal::Error(fmt::format("{} has no receive queues to steer (CONFIG_RPS)", interface));
  return found;
}

Things interrupts(Text interface) {
  Things found;
  for (const int number : interrupts_of(interface)) found.push_back({&interrupt, interrupt_here(number)});
  if (found.empty()) throw journal::Error(fmt::format("{} has no interrupts: not hardware", interface));
  return found;
}

bool threads_all_interrupts() {
  return read_file("/sys/kernel/realtime") == "1" ||
         (" " + read_file("/proc/cmdline").value_or("") + " ").find(" threadirqs ") != std::string::npos;
}

Things interrupt_threads(Text interface) {
  Things found;
  for (const int number : interrupts_of(interface))
    for (auto& one : threads_named(fmt::format("irq/{}-", number))) found.push_back(std::move(one));
  if (!found.empty()) return found;
  if (!threads_all_interrupts())
    throw journal::Error("this kernel has no IRQ threads. Fix: boot with threadirqs, or a PREEMPT_RT kernel");
  interrupts(interface);
  throw journal::Error(fmt::format("the interrupts of {} have no threads: its driver uses none", interface));
}

Things threadable(Text interface) {
  refuse_bridge(interface);
  const auto what = interface_here(interface);
  if (!threaded.read(what)) throw journal::Error("this kernel has no threaded NAPI (needs Linux 5.12)");
  return {{&threaded, what}};
}

Things napi_threads(Text interface) {
  refuse_bridge(interface);
  auto found = napi_threads_of(interface);
  if (found.empty() || threaded.read(interface_here(interface)) == "0")
    throw journal::Error(
        fmt::format("{} has no NAPI threads. Fix: also set kernel.threaded-napi: on (--set "
                    "threaded-napi=on)",
                    interface));
  return found;
}

constexpr const char *priority = "1-99|other", *cpus = "LIST", *on_off = "on|off", *bytes = "SIZE",
                     *us = microseconds;

const Setting all[] = {
    {"rt-throttling", on_off, "leave 5 % of each second to tasks that are not real-time", false, "",
     switch_stated, throttled, throttling},
    {"timer-migration", on_off, "move timers of idle CPUs to busy ones", false, "", switch_stated, timers,
     one_or_zero},
    {"governor", "NAME", "frequency governor of all CPUs, such as performance", false, "", governor_stated,
     governors, a_governor_there_is},
    {"workqueue-cpus", cpus, "CPUs for the kernel's unbound work", false, "", cpus_stated, unbound_work,
     these_cpus},
    {"rmem-max", bytes, "largest receive buffer that a socket may request", false, "", bytes_stated, rmem_max,
     as_asked},
    {"rmem-default", bytes, "receive buffer of a socket that requests none", false, "", bytes_stated,
     rmem_default, as_asked},
    {"wmem-max", bytes, "largest send buffer that a socket may request", false, "", bytes_stated, wmem_max,
     as_asked},
    {"wmem-default", bytes, "send buffer of a socket that requests none", false, "", bytes_stated,
     wmem_default, as_asked},
    {"busy-poll", us, "microseconds for which poll() and select() poll the device", false, "", us_stated,
     busy_poll, as_asked},
    {"busy-read", us, "microseconds for which a read polls the device", false, "", us_stated, busy_read,
     as_asked},
    {"gro", on_off, "merge received packets before the stack sees them, on the interface", true, "",
     switch_stated, offloaded, as_asked},
    {"coalescing", "NAME=N,...",
     "interrupt coalescing of the interface: rx-usecs, rx-frames, tx-usecs, tx-frames, adaptive-rx, "
     "adaptive-tx",
     true, "", coalescing_stated, coalesced, with_this_coalescing},
    {"rps", "LIST|none", "CPUs that process the interface's packets", true, "", cpus_or_none_stated, steered,
     these_cpus},
    {"irq-cpus", cpus, "CPUs for the interface's interrupts", true, "", cpus_stated, interrupts, these_cpus},
    {"irq-threads", priority, "SCHED_FIFO priority of the interface's interrupt threads", true, "",
     priority_stated, interrupt_threads, with_this_priority},
    {"ksoftirqd", "1-99|other|CPU=...",
     "SCHED_FIFO priority of ksoftirqd on all CPUs, or for each CPU, such as 0=60,1=50", false, "",
     priorities_stated, softirqs, with_priority_of_its_cpu},
    {"threaded-napi", on_off, "receive the interface's packets in threads of their own (threaded NAPI)", true,
     "", switch_stated, threadable, one_or_zero},
    {"napi-threads", priority, "SCHED_FIFO priority of the threads of threaded NAPI", true, "threaded-napi",
     priority_stated, napi_threads, with_this_priority},
    {"napi-cpus", cpus, "CPUs of the threads of threaded NAPI", true, "threaded-napi", cpus_stated,
     napi_threads, with_these_cpus}};

}  // namespace

std::span<const Setting> table() { return all; }

std::span<const journal::Kind> kinds() {
  static const std::vector<journal::Kind> all_kinds = {
      thread,    thread_priority, network_sysctl, kernel_sysctl, governor, workqueues,
      interrupt, threaded,        steering,       coalescing,    gro};
  return all_kinds;
}

std::string Thing::title() const {
  if (kind == &thread || kind == &thread_priority) return name_of_thread(what);
  if (kind == &workqueues) return "unbound work";
  if (kind == &interrupt) return "interrupt " + what.substr(0, what.find(':'));
  if (is_interface(what.substr(0, what.find('/')))) return name_of_interface(what);
  return what;
}

std::string value_that_keeps(const Setting& setting, const Thing& thing, const std::string& now) {
  if (setting.stated == bytes_stated) return now + " B";
  if (setting.stated == us_stated) return now + " us";
  std::vector<std::string> words{now, "on", "off", "other", "none", realtime::list_of(online_cpus())};
  for (int number = 0; number <= 99; ++number) words.push_back(std::to_string(number));  // a priority, a CPU
  for (const auto& word : words) try {
      setting.stated(word);
      if (setting.wanted(word, thing, now) == now) return word;
    } catch (const std::exception&) {  // no value of this setting, or none that can be had here
    }
  return now;
}

std::string values_that_keep(const State& state) {
  const bool is_of_cpus = state.setting->wanted == with_priority_of_its_cpu;
  std::string each, one;
  bool are_alike = true;
  for (const auto& [thing, now] : state.things) {
    const auto value = value_that_keeps(*state.setting, thing, now), title = thing.title();
    are_alike = are_alike && (each.empty() || value == one);
    one = value;
    each += is_of_cpus
                ? fmt::format("{}{}={}", each.empty() ? "" : ",", title.substr(title.find('/') + 1), value)
                : fmt::format("{}{} {}", each.empty() ? "" : ", ", title, value);
  }
  return are_alike ? one : each;
}

const Wishes& paper() {
  static const Wishes wishes = {{"irq-threads", "90"}, {"ksoftirqd", "60"}};
  return wishes;
}

}  // namespace ontime::settings

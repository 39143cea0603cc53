// SPDX-License-Identifier: Apache-2.0
// The causes in words, and what mends them: a row each.
#include <algorithm>
#include <array>
#include <string_view>

#include <fmt/format.h>

#include "explain/explain.hpp"

namespace ontime::explain {
namespace {

// {0}: whose thread, such as "pong's receive thread"; {1}: the culprit.
struct Row {
  Cause cause;
  const char *word, *sentence, *without_culprit, *remedy;
};
constexpr const char* none = "";
constexpr Row rows[] = {
    {Cause::cpu, "cpu", "{0} waited for a CPU while {1} ran", "{0} waited for a CPU", none},
    {Cause::interrupts, "interrupts", "{1} took the CPU of {0}", "interrupts took the CPU of {0}",
     "kernel.irq-cpus: interrupts to other CPUs than {0} has"},
    {Cause::throttled, "throttled", none,
     "{0} was ready, but was kept from its CPU: throttled, by its cgroup's quota or as a real-time thread",
     "give its cgroup more (cpu.max, cpu.cfs_quota_us), and real-time threads too "
     "(kernel.rt-throttling: off)"},
    {Cause::idle_cpu, "idle-cpu", none,
     "{0} was ready, but its CPU showed no sign of life: it woke slowly, or a hypervisor did not run it",
     "realtime.cpu-latency: 0 us; a virtual CPU is pinned at its host, no setting here helps"},
    {Cause::stopped, "stopped", "{0} was stopped by a signal from {1}", "{0} was stopped by a signal",
     "nobody should stop it (SIGSTOP, SIGTSTP)"},
    {Cause::page_fault, "page-fault", none,
     "{0} waited for pages of its memory that were not there: to be read from a disk, or to be freed",
     "realtime.lock-memory: on"},
    {Cause::lock, "lock", "{0} waited for a lock of the kernel's, which {1} had",
     "{0} waited for a lock of the kernel's",
     "fewer mappings and threads made and ended while messages go; realtime.lock-memory: on"},
    {Cause::disk, "disk", none, "{0} waited for a disk", "no files are written or read on a message's way"},
    {Cause::blocked, "blocked", none, "{0} waited in the kernel (state D), it is not known for what",
     "realtime.lock-memory: on"},
    {Cause::waited, "waited", "{0} slept until {1} woke it, which had a lock, or work to do first",
     "{0} slept on its way, of its own accord", none},
    {Cause::busy, "busy", none, "{0} had its CPU, and took so long (or a hypervisor did not run it)", none},
    {Cause::timer, "timer", none,
     "the timer that wakes {0} came late: its CPU had interrupts off, or a hypervisor did not run it",
     "a virtual CPU is pinned at its host; no setting here helps"},
    {Cause::queue, "queue", "the packet was held at {0}, by the queue of {1}",
     "the packet was held at {0}, by a queue",
     "tc -s qdisc show dev {1}: a rate, a delay, or other traffic ahead of it"},
    {Cause::dropped, "dropped", "the packet was dropped at {0} ({1})",
     "the packet was dropped at {0}, the kernel does not say why", none},
    {Cause::unreachable, "unreachable", "the packet could not be sent at {0}: {1}", none,
     "ip route get ADDRESS, ip neigh: the interface, or the other end's, was down or lost its address"},
    {Cause::link_down, "link-down", "the link was down at {0}: {1}", none,
     "who takes the interface down, its cable, its driver: ip monitor link, journalctl -k"},
    {Cause::unknown, "unknown", none, "unknown", none}};

const Row& row_of(Cause cause) {
  return *std::find_if(std::begin(rows), std::end(rows), [&](const Row& row) { return row.cause == cause; });
}

// By a function of the kernel that a thread is in: the first that fits.
struct Wait {
  std::string_view function;
  Cause cause;
};
constexpr Wait waits[] = {{"rtlock_slowlock", Cause::lock},   {"rt_mutex_", Cause::lock},
                          {"rwsem_down_", Cause::lock},       {"mutex_lock", Cause::lock},
                          {"percpu_rwsem_wait", Cause::lock}, {"handle_mm_fault", Cause::page_fault},
                          {"page_fault", Cause::page_fault},  {"io_schedule", Cause::disk}};

// By how the kernel's word for a reason begins.
struct Drop {
  std::string_view reason;
  const char* remedy;
};
constexpr Drop drops[] = {
    {"NETFILTER", "a rule of a packet filter dropped it: nft list ruleset"},
    {"SOCKET_RCVBUFF",
     "a larger receive buffer (kernel.rmem-max, and the transport's option), or a reader that is "
     "not kept from its CPU"},
    {"PROTO_MEM", "net.ipv4.udp_mem: sockets of the whole machine are out of memory"},
    {"QDISC", "tc -s qdisc: the interface's queue was full, or its rate was reached"},
    {"TC_", "tc filter show: a filter dropped it"},
    {"NO_SOCKET", "nobody listened there: was the other end gone?"},
    {"CPU_BACKLOG", "net.core.netdev_max_backlog, and a ksoftirqd that is not starved (kernel.ksoftirqd)"},
    {"DEV_READY", "the interface at the other side was down"},
    {"__dev_forward_skb", "the interface at the other side was down, or its MTU is smaller than the packet"}};

std::string possessive(const std::string& end) { return end == "component" ? "pong's" : "ping's"; }

std::string whose(const Part& part) {
  if (part.thread.empty()) return possessive(part.end) + " side";
  if (part.stage == Stage::travelled)
    return fmt::format("{}, by which packets come to {} end,", part.thread, possessive(part.end));
  return fmt::format("{} {} thread", possessive(part.end), part.thread);
}

std::string for_a_cpu(const Part& part) {
  if (part.stage == Stage::travelled)
    return fmt::format("kernel.{}: a priority above {}'s",
                       part.thread.starts_with("irq/")    ? "irq-threads"
                       : part.thread.starts_with("napi/") ? "napi-threads"
                                                          : "ksoftirqd",
                       part.culprit);
  if (part.priority >= trace::least_ordinary)
    return fmt::format("realtime: on (of this thread alone: realtime.{}.priority: 80)", part.thread);
  return fmt::format("realtime.{}.priority above {}'s, or realtime.{}.cpus apart from it", part.thread,
                     part.culprit, part.thread);
}

}  // namespace

Cause cause_of_wait(const std::string& functions) {
  for (const auto& [function, cause] : waits)
    if (functions.find(function) != functions.npos) return cause;
  return Cause::blocked;
}

const char* word_of(Cause cause) { return row_of(cause).word; }

const char* word_of(Stage stage) {
  constexpr const char* words[] = {"woke", "sent", "left", "queued", "travelled", "delivered", "answered"};
  return words[static_cast<std::size_t>(stage)];
}

std::string sentence_of(const Part& part) {
  const auto& row = row_of(part.cause);
  const bool without = part.culprit.empty() || *row.sentence == '\0';
  return fmt::format(fmt::runtime(without ? row.without_culprit : row.sentence), whose(part), part.culprit);
}

std::string remedy_of(const Part& part) {
  if (part.cause == Cause::cpu) return for_a_cpu(part);
  if (part.cause == Cause::dropped)
    for (const auto& [reason, remedy] : drops)
      if (part.culprit.starts_with(reason)) return remedy;
  return fmt::format(fmt::runtime(row_of(part.cause).remedy), whose(part), part.culprit);
}

}  // namespace ontime::explain

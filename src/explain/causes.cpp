// SPDX-License-Identifier: Apache-2.0
#include "explain/causes.hpp"

#include <algorithm>
#include <string_view>

#include <fmt/format.h>

#include "explain/explain.hpp"
#include "transport/shipped.hpp"

namespace ontime::explain {
namespace {

using roundtrip::Where;

// In texts {0} is the delayed thread ("pong's receive thread"), {1} the culprit, {2} the thread's role.
constexpr const char* none = "";
struct Row {
  Cause cause;
  const char *word, *without_culprit, *sentence = none, *advice = none;
  std::vector<Setting> settings{};  // alternatives: each one helps
};
const Row rows[] = {
    {Cause::cpu,
     "cpu",
     "{0} waited for a CPU",
     "{0} waited for a CPU while {1} ran",
     none,
     {{"realtime", "on"},
      {"realtime.{2}.priority", "above the priority of {1}"},
      {"realtime.{2}.cpus", "other CPUs than those of {1}"}}},
    {Cause::not_preempted, "not-preempted",
     "{0} waited for a CPU while a thread of lower priority had it: no preemption, or a hypervisor paused "
     "the CPU",
     "{0} waited for a CPU while {1} ran at lower priority: the kernel did not preempt it",
     "no setting of ontime helps; use a PREEMPT_RT kernel; in a virtual machine pin its CPUs at the host"},
    {Cause::interrupts,
     "interrupts",
     "interrupts took the CPU of {0}",
     "{1} took the CPU of {0}",
     none,
     {{"kernel.irq-cpus", "other CPUs than that of {0}"}}},
    {Cause::throttled,
     "throttled",
     "{0} was ready but throttled: by the CPU quota of its cgroup, or by real-time throttling",
     none,
     "raise the quota of its cgroup (cpu.max, cpu.cfs_quota_us); from Linux 6.12 on see fair-server in "
     "`ontime check`",
     {{"kernel.rt-throttling", "off"}}},
    {Cause::idle_cpu,
     "idle-cpu",
     "{0} was ready, but no event shows its CPU running: slow exit from an idle state, or a hypervisor "
     "paused it",
     none,
     "if a hypervisor paused the CPU, pin it on the host",
     {{"realtime.cpu-latency", "0 us"}}},
    {Cause::stopped, "stopped", "{0} was stopped by a signal", "{0} was stopped by a signal from {1}",
     "find what sends SIGSTOP or SIGTSTP"},
    {Cause::traced, "traced", "{0} was stopped by a tracer (ptrace)",
     "{0} was stopped by its tracer {1} (ptrace)", "measure without a debugger, strace or another tracer"},
    {Cause::frozen, "frozen", "{0} was frozen", "{0} was frozen, and {1} thawed it",
     "find what freezes its cgroup (docker pause, cgroup.freeze) or suspends the machine"},
    {Cause::page_fault,
     "page-fault",
     "{0} waited for memory: pages were read from disk, or memory had to be freed",
     none,
     none,
     {{"realtime.lock-memory", "on"}}},
    {Cause::lock,
     "lock",
     "{0} waited for a kernel lock",
     "{0} waited for a kernel lock held by {1}",
     "map no memory and start no threads while messages are sent",
     {{"realtime.lock-memory", "on"}}},
    {Cause::disk, "disk", "{0} waited for a disk", none,
     "read and write no files in the threads that handle messages"},
    {Cause::blocked, "blocked", "{0} was blocked in the kernel (state D); the trace does not show by what"},
    {Cause::waited, "waited", "{0} slept while it had the message to handle",
     "{0} slept until {1} woke it, which held a lock, worked first, or thawed it"},
    {Cause::busy, "busy", "{0} had its CPU and ran this long (or a hypervisor paused the CPU)"},
    {Cause::timer, "timer",
     "the timer that wakes {0} came late: its CPU had interrupts off, or a hypervisor paused it", none,
     "in a virtual machine pin its CPUs at the host"},
    {Cause::queue, "queue", "the packet waited in a queue at {0}",
     "the packet waited at {0} in the queue of {1}",
     "tc -s qdisc show dev {1}: look for a rate, a delay, or other traffic ahead of it"},
    {Cause::dropped, "dropped", "the packet was dropped at {0}; the kernel gives no reason",
     "the packet was dropped at {0} ({1})"},
    {Cause::unreachable, "unreachable", none, "the packet could not be sent at {0}: {1}",
     "an interface of the sender or the receiver was down or lost its address: ip route get ADDRESS, ip "
     "neigh"},
    {Cause::link_down, "link-down", none, "the link was down at {0}: {1}",
     "check the cable and the driver, and what takes the interface down: ip monitor link, journalctl -k"},
    {Cause::unknown, "unknown", "unknown: no kernel event shows the cause at {0}"}};

const Row& row_of(Cause cause) { return *std::ranges::find(rows, cause, &Row::cause); }

// The cause by the kernel function that a thread waits in: the first match counts.
constexpr std::pair<std::string_view, Cause> waits[] = {{"__refrigerator", Cause::frozen},
                                                        {"rtlock_slowlock", Cause::lock},
                                                        {"rt_mutex_", Cause::lock},
                                                        {"rwsem_down_", Cause::lock},
                                                        {"mutex_lock", Cause::lock},
                                                        {"percpu_rwsem_wait", Cause::lock},
                                                        {"handle_mm_fault", Cause::page_fault},
                                                        {"page_fault", Cause::page_fault},
                                                        {"io_schedule", Cause::disk}};

// By the prefix of the kernel's drop reason.
struct Drop {
  std::string_view reason;
  const char* advice;
  std::vector<Setting> settings{};
};
const Drop drops[] = {
    {"NETFILTER", "a packet filter rule dropped it: nft list ruleset"},
    {"SOCKET_RCVBUFF",
     "a larger receive buffer (option of the transport); a reader that gets its CPU sooner",
     {{"kernel.rmem-max", "more bytes"}}},
    {"PROTO_MEM", "raise net.ipv4.udp_mem: all sockets of the machine together are out of memory"},
    {"QDISC", "the interface's queue was full, or its rate limit was reached: tc -s qdisc"},
    {"TC_", "a filter dropped it: tc filter show"},
    {"NO_SOCKET", "no socket was open there: check that the receiving program runs"},
    {"CPU_BACKLOG",
     "raise net.core.netdev_max_backlog",
     {{"kernel.ksoftirqd", "above the priority of the threads that keep it from its CPU"}}},
    {"DEV_READY", "the receiving interface was down: ip link"},
    {"__dev_forward_skb",
     "the receiving interface was down, or its MTU is smaller than the packet: ip link"}};

constexpr std::string_view softirqs_of_network[] = {"NET_RX", "NET_TX"},
                           softirqs_of_others[] = {"HI",      "TIMER", "BLOCK",   "IRQ_POLL",
                                                   "TASKLET", "SCHED", "HRTIMER", "RCU"};
constexpr std::string_view timer_interrupt = "timer interrupt";

template <class Names>
bool is_of(const Names& names, const std::string& name) {
  return std::find(std::begin(names), std::end(names), name) != std::end(names);
}

std::string possessive(const std::string& end) { return end == "component" ? "pong's" : "ping's"; }

std::string whose(const Part& part) {
  if (part.thread.empty()) return possessive(part.end) + " side";
  if (part.stage == Stage::travelled)
    return fmt::format("{} (receives packets for {} side)", part.thread, possessive(part.end));
  const auto own = fmt::format("{} {} thread", possessive(part.end), part.thread);
  return part.via.empty() ? own : fmt::format("{} ({} waited for it)", part.via, own);
}

std::string filled(const std::string& text, const Part& part, const std::string& whose) {
  return fmt::format(fmt::runtime(text), whose, part.culprit, part.thread);
}
std::string filled(const std::string& text, const Part& part) { return filled(text, part, whose(part)); }

bool is_real_time(const Part& part) { return part.priority < trace::least_ordinary; }

// No priority is above the highest of SCHED_FIFO, which the kernel's own threads have, or above
// SCHED_DEADLINE.
bool can_be_outranked(const Part& part) { return part.culprit_priority > 0; }

// Whether this setting changes anything for this thread.
bool can_help(const std::string& key, const Part& part) {
  if (!part.via.empty()) return false;  // no scenario setting applies to the thread that was waited for
  if (key == "realtime") return !is_real_time(part) && can_be_outranked(part);
  if (key == "realtime.{2}.priority") return is_real_time(part) && can_be_outranked(part);
  if (key == "realtime.{2}.cpus") return is_real_time(part) || !can_be_outranked(part);
  if (key == "kernel.rt-throttling") return is_real_time(part);
  if (key == "kernel.irq-cpus")
    return part.culprit != timer_interrupt && !is_of(softirqs_of_others, part.culprit);
  return true;
}

// Kernel threads have their own keys.
Remedy of_kernel_thread(const Part& part) {
  const bool of_napi = part.thread.starts_with("napi/");
  Remedy remedy;
  if (can_be_outranked(part))
    remedy.settings.push_back({of_napi                           ? "kernel.napi-threads"
                               : part.thread.starts_with("irq/") ? "kernel.irq-threads"
                                                                 : "kernel.ksoftirqd",
                               filled("above the priority of {1}", part)});
  if (of_napi) remedy.settings.push_back({"kernel.napi-cpus", filled("other CPUs than those of {1}", part)});
  return remedy;
}

// Whether the callbacks of its background topics run on the thread that receives its messages.
bool shares_callbacks(const record::Run& run, const std::string& end) {
  const auto& task = run.asked.task;
  const auto& background = task.background;
  const bool is_component = end == "component";
  if (!(is_component ? background.there : background.back)) return false;
  const auto& transport = is_component ? run.asked.component_transport : task.transport;
  const auto& options = is_component ? run.asked.component_options : task.config.options;
  const auto executor = options.find("executor");
  const auto& declared = record::find(run.outcome.hosts, end).transport;
  const auto* const own = transport::shipped(transport);  // for records that lack what it declared
  const bool nodes = declared.nodes.value_or(own != nullptr && own->can.nodes);
  const bool shares_threads = declared.shares_threads.value_or(own != nullptr && own->can.shares_threads);
  const bool has_thread_per_topic = task.config.receive == transport::Receive::waitset;
  switch (background.where) {
    case Where::same_callback_group:
      return true;
    case Where::same_node:
    case Where::same_executor:
      return executor == options.end() || executor->second != "multi";
    case Where::same_participant:
      return !has_thread_per_topic && !nodes;
    case Where::same_process:
      return !has_thread_per_topic && shares_threads;
    default:
      return false;
  }
}

// The remedy where callbacks of the background topics keep the thread busy; nullopt: they do not.
std::optional<Remedy> remedy_of_callbacks(const Part& part, const record::Run& run) {
  const auto callback = run.asked.task.background.callback;
  if (part.cause != Cause::busy || part.thread != "receive" || callback.count() <= 0 ||
      !shares_callbacks(run, part.end))
    return {};
  return Remedy{{{"background.where", "a value that gives them their own thread"}},
                fmt::format("callbacks of the background topics, {:g} ms each, run on this thread",
                            static_cast<double>(callback.count()) / 1e6)};
}

// For a lost message without a known cause: how far its packet came.
std::string sentence_of_lost(const Part& part) {
  const auto* const sender = part.end == "component" ? "ping's" : "pong's";
  if (part.stage == Stage::travelled)
    return fmt::format("unknown: its packet left {} side; no later event shows it", sender);
  if (part.stage == Stage::delivered)
    return fmt::format("unknown: its packet came to {} side; no later event shows it", possessive(part.end));
  return fmt::format("unknown: no event shows that its packet left {} side", possessive(part.end));
}

// The keys that are set, joined by that word; empty: none is.
std::string set_ones(const std::vector<std::pair<const char*, bool>>& keys, const char* joint) {
  std::string text;
  for (const auto& [key, is_set] : keys)
    if (is_set) text += (text.empty() ? "" : joint) + std::string(key);
  return text;
}

bool is_work_on_packets(const Part& part) {
  return (part.cause == Cause::interrupts && is_of(softirqs_of_network, part.culprit)) ||
         (part.cause == Cause::busy && (part.stage == Stage::left || part.stage == Stage::travelled));
}

// Faults of the link that the run asked for. ontime makes them with rules of the packet filter and with
// queueing disciplines, which are gone after the run: advice on the user's own ones would be wrong. Empty:
// the run asked for no fault that explains this part.
std::string advice_on_asked_faults(const Part& part, const conditions::Faults& faults) {
  const bool is_dropped = part.cause == Cause::dropped;
  const auto of_scenario = [](const std::string& keys, const char* what) {
    return keys.empty() ? "" : fmt::format("the scenario's own {} {}", keys, what);
  };
  if (is_dropped && part.culprit.starts_with("NETFILTER"))
    return of_scenario(set_ones({{"link.loss", faults.loss > 0}, {"link.cut", faults.cut}}, " or "),
                       "dropped it");
  if (part.cause == Cause::queue || (is_dropped && part.culprit.starts_with("QDISC")))
    return of_scenario(set_ones({{"link.delay", faults.delay.count() > 0},
                                 {"link.jitter", faults.jitter.count() > 0},
                                 {"link.reorder", faults.reordered > 0},
                                 {"link.qdisc", !faults.qdisc.empty()}},
                                " with "),
                       "made this queue");
  if (is_work_on_packets(part))
    return of_scenario(set_ones({{"link.loss", faults.loss > 0},
                                 {"link.cut", faults.cut},
                                 {"link.duplicate", faults.duplicates > 0}},
                                " with "),
                       "added packet filter rules");
  return "";
}

std::string advice_for(const Part& part) {
  if (!part.via.empty() && part.cause == Cause::cpu && can_be_outranked(part))
    return "a mutex with priority inheritance (PTHREAD_PRIO_INHERIT), or a higher priority for " + part.via;
  if (part.cause == Cause::interrupts && part.culprit == timer_interrupt)
    return "no setting moves a CPU's timer interrupt; if it takes milliseconds, a hypervisor paused the CPU";
  if (is_work_on_packets(part)) return "use fewer packet filter rules: nft list ruleset";
  return filled(row_of(part.cause).advice, part);
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

std::string stated(const conditions::Run& run, const std::string& key) {
  const auto& realtime = run.task.realtime;
  if (key == "realtime") return realtime.on ? "on" : "";
  if (key == "realtime.lock-memory") return realtime.lock_memory ? "on" : "";
  if (key == "realtime.cpu-latency")
    return realtime.cpu_latency == std::chrono::microseconds(0) ? "0 us" : "";
  constexpr std::string_view kernel = "kernel.";
  if (!key.starts_with(kernel)) return "";
  const auto found = run.kernel.find(key.substr(kernel.size()));
  return found == run.kernel.end() ? "" : found->second;
}

std::string sentence_of(const Part& part) {
  return part.cause == Cause::unknown && part.ns == 0 ? sentence_of_lost(part)
                                                      : sentence_of(part, whose(part));
}

std::string sentence_of(const Part& part, const std::string& whose) {
  const auto& row = row_of(part.cause);
  const bool without = part.culprit.empty() || *row.sentence == '\0';
  return filled(without ? row.without_culprit : row.sentence, part, whose);
}

std::string advice_of(const Part& part, const std::string& whose) {
  return filled(row_of(part.cause).advice, part, whose);
}

Remedy remedy_for(const Part& part, const record::Run& run) {
  if (part.cause == Cause::cpu && part.stage == Stage::travelled) return of_kernel_thread(part);
  const auto asked_for = advice_on_asked_faults(part, run.asked.faults);
  if (!asked_for.empty() && !is_work_on_packets(part)) return {{}, asked_for};
  if (part.cause == Cause::dropped)
    for (const auto& [reason, advice, settings] : drops)
      if (part.culprit.starts_with(reason)) return {settings, advice};
  if (const auto remedy = remedy_of_callbacks(part, run)) return *remedy;
  Remedy remedy{{}, asked_for.empty() ? advice_for(part) : asked_for};
  for (const auto& setting : row_of(part.cause).settings) {
    if (!can_help(setting.key, part)) continue;
    if (stated(run.asked, setting.key) != setting.value)
      remedy.settings.push_back({filled(setting.key, part), filled(setting.value, part)});
    else if (setting.key == "realtime")
      remedy.advice = filled(
          "realtime is on, but not for this thread: check what was denied, or set realtime.{2}.priority",
          part);
  }
  return remedy;
}

std::string text_of(const Remedy& remedy) {
  std::string text;
  for (const auto& [key, value] : remedy.settings)
    text += fmt::format("{}{}: {}", text.empty() ? "" : ", or ", key, value);
  return text + (text.empty() || remedy.advice.empty() ? "" : "; ") + remedy.advice;
}

}  // namespace ontime::explain

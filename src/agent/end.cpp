// SPDX-License-Identifier: Apache-2.0
#include "agent/end.hpp"

#include <algorithm>
#include <fstream>
#include <string_view>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "agent/privileges.hpp"
#include "message/message.hpp"
#include "orders/orders.hpp"

namespace ontime::agent {
namespace {

using orders::Error;

// Prefix of the role of a thread that serves only background topics.
constexpr std::string_view of_background = "background ";

// Enough for a middleware's own allocations from set-up to end, so that none of them has to fault pages in.
constexpr std::size_t heap_bytes = std::size_t{32} << 20;

constexpr std::uint64_t mebibyte = std::uint64_t{1} << 20U;
constexpr std::uint64_t locked_bytes = 192 * mebibyte;  // 165 to 185 MB were seen
constexpr std::uint64_t most_reserve = 256 * mebibyte;
// Of its own: 62 to 121 MB were seen. The pages of its files may be charged to another control group.
constexpr std::uint64_t own_locked_bytes = 64 * mebibyte;

// Finds the address of the requested interface: the stated one if the interface has it, else its first. What
// is stated may be a name, or the address of a router.
void resolve(transport::Config& config) {
  const auto stated = std::exchange(config.address, "");
  if (config.interface.empty()) return;
  std::vector<std::string> others;
  const auto all = machine::interfaces();
  for (const auto& interface : all) {
    others.push_back(interface.name);
    if (interface.name != config.interface) continue;
    if (!interface.up)
      throw Error(3, fmt::format("interface '{0}' is down. Fix: sudo ip link set {0} up", interface.name));
    const auto& own = interface.addresses;
    if (own.empty()) throw Error(3, lacks_address(interface.name, machine::master_of(interface.name), all));
    const auto same = std::ranges::find(own, stated.substr(0, stated.find(':')));
    config.address = same == own.end() ? own.front() : *same;
    return;
  }
  throw Error(2, fmt::format("this host has no interface '{}'; it has: {}", config.interface,
                             fmt::join(others, ", ")));
}

void check(const transport::Plugin& plugin, const Task& task) {
  const auto& can = plugin.capabilities;
  const auto beside = task.background.topics > 0 ? task.background.payload_bytes : 0;
  if (const auto largest = std::max(task.config.max_payload_bytes, beside); largest > can.max_payload_bytes)
    throw Error(2, fmt::format("transport {} carries at most {} bytes of payload; {} were requested",
                               plugin.name, can.max_payload_bytes, largest));
  const bool listener = task.config.receive == transport::Receive::listener;
  if (listener ? !can.listener : !can.waitset)
    throw Error(2, fmt::format("transport {} does not support receive: {}", plugin.name,
                               conditions::word_of(task.config.receive)));
  if (task.config.security && !can.security)
    throw Error(
        2, fmt::format("transport {} has no DDS Security (security: {}). Fix: remove the key, or use another "
                       "transport",
                       plugin.name, task.config.security->level));
  if (task.config.launch_ns > 0 && !can.launch_time)
    throw Error(2,
                fmt::format("transport {} does not support launch-time: it does not send through a socket of "
                            "ontime. Fix: remove the key, or use another transport",
                            plugin.name));
  const transport::Config unnamed;
  if (!can.topics &&
      (task.config.ping_topic != unnamed.ping_topic || task.config.pong_topic != unnamed.pong_topic))
    throw Error(
        2,
        fmt::format("transport {} has no topic names; requested: {}, {}. Fix: separate servers by --domain "
                    "or port",
                    plugin.name, task.config.ping_topic, task.config.pong_topic));
  if (const auto why = transport::unknown_option(plugin.name, plugin.options, task.config.options);
      !why.empty())
    throw Error(2, why);
}

std::optional<std::uint64_t> since(const std::optional<std::uint64_t>& before,
                                   const std::optional<std::uint64_t>& now) {
  if (!now) return {};
  return *now - std::min(*now, before.value_or(0));
}

}  // namespace

End::End(Task task) : task_(std::move(task)) {
  resolve(task_.config);
  task_.config.deadline_ns = task_.client.deadline.count();
  // Memory first: what is created afterwards is born locked, and touched.
  if (task_.realtime.lock_memory) {
    std::ifstream meminfo("/proc/meminfo");
    if (const auto why = lacks_memory(meminfo, machine::group_memory());
        realtime::may_lock_all() && !why.empty())
      throw Error(3, why);
    refuse(realtime::lock_memory(heap_bytes));
  }
  if (task_.realtime.cpu_latency) {
    latency_ = std::make_unique<realtime::CpuLatencyRequest>(*task_.realtime.cpu_latency);
    if (latency_->refusal()) refuse({*latency_->refusal()});
  }
  plugin_ = &transport::load(task_.transport);
  check(*plugin_, task_);
  for (const auto& [role, settings] : task_.realtime.threads)
    if (settings.policy == realtime::Policy::fifo && realtime::may_use_fifo(settings.priority))
      task_.config.fifo_priority[role] = settings.priority;
  try {
    open();
  } catch (const transport::WrongInput& wrong) {
    throw Error(2, wrong.what());
  }
  set_threads();
}

void End::open() {
  const bool some = task_.background.topics > 0;
  const bool alone = some && task_.background.where == roundtrip::Where::other_process;
  if (!alone && task_.config.role == transport::Role::client)
    client_ = std::make_unique<roundtrip::Client>(*plugin_, task_.config, task_.client);
  else if (!alone)
    server_ = std::make_unique<roundtrip::Server>(*plugin_, task_.config);
  if (some)
    background_ = std::make_unique<roundtrip::BackgroundTopics>(
        *plugin_, alone ? nullptr : &endpoint(), task_.config, task_.background, task_.client.duration);
}

std::vector<transport::Thread> End::threads() {
  auto all = client_ ? client_->threads() : server_ ? server_->threads() : std::vector<transport::Thread>{};
  if (!background_) return all;
  for (auto& thread : background_->threads()) {
    if (std::ranges::count(all, thread.tid, &transport::Thread::tid) == 0)
      all.push_back({thread.tid, std::string(of_background) + thread.role, thread.name});
  }
  return all;
}

void End::drop_privileges() {
  for (const auto& thread : agent::drop_privileges(task_.count_instructions))
    refuse({{"fewer privileges for thread " + thread, "the thread blocks the signal that drops them",
             "none: the thread reads from the network with all privileges"}});
}

record::Host End::opened() {
  record::Host host;
  const auto facts = endpoint().facts();
  const auto& can = plugin_->capabilities;
  host.transport = {.name = plugin_->name,
                    .version = plugin_->version(),
                    .facts = {facts.begin(), facts.end()},
                    .below_ip = can.below_ip,
                    .past_the_kernel = can.past_the_kernel,
                    .nodes = can.nodes,
                    .shares_threads = can.shares_threads};
  host.refusals = refusals_;
  return host;
}

void End::set_threads() {
  for (const auto& thread : threads()) {
    if (thread.role.starts_with(of_background)) {
      set_thread_of_background(thread);
      continue;
    }
    if (!task_.realtime.on || !set_.insert(thread.tid).second) continue;
    if (thread.role == "unknown") {
      refuse({{"settings for thread " + thread.name, "the kernel does not show the thread's role",
               "grant permissions by limits, not by file capabilities (docs/how-to/realtime.md)"}});
      continue;
    }
    auto settings = task_.realtime.threads.find(thread.role);
    if (settings == task_.realtime.threads.end()) settings = task_.realtime.threads.find("other");
    if (settings == task_.realtime.threads.end()) continue;
    auto asked = settings->second;
    if (thread.role == "resend") {
      asked.policy = realtime::Policy::other;
      asked.priority = 0;
    }
    refuse(realtime::apply(thread.tid, thread.role, asked));
  }
}

// Only threads that background messages pass through, and only if background.priority is set.
void End::set_thread_of_background(const transport::Thread& thread) {
  const auto role = thread.role.substr(of_background.size());
  if (role != "send" && role != "receive" && role != "delivery") return;
  if (task_.background.priority == 0 || !set_.insert(thread.tid).second) return;
  refuse(
      realtime::apply(thread.tid, thread.role,
                      {.policy = realtime::Policy::fifo, .priority = task_.background.priority, .cpus = {}}));
}

void End::begin() {
  set_threads();
  before_.clear();
  instructions_.clear();
  for (const auto& thread : threads()) {
    if (task_.count_instructions) instructions_.emplace(thread.tid, thread.tid);
    if (const auto state = realtime::read(thread.tid)) before_[thread.tid] = *state;
  }
  answered_before_ = server_ ? server_->answered() : 0;
  losses_before_ = endpoint().losses();
  drops_before_ = machine::drops(task_.config.interface);
  quotas_before_ = machine::cpu_quotas();
  if (task_.config.interface.empty()) return;
  traffic_before_ = machine::traffic(task_.config.interface);
  link_watch_ = std::make_unique<machine::LinkWatch>(task_.config.interface);
}

record::Host End::ended() {
  auto host = opened();
  for (const auto& thread : threads())
    if (const auto now = realtime::read(thread.tid)) host.threads.push_back(during(thread, *now));
  host.losses = losses();
  host.drops =
      record::read<record::Drops>(machine::between(drops_before_, machine::drops(task_.config.interface)));
  if (const auto quota = machine::between(quotas_before_, machine::cpu_quotas()))
    host.cpu_quota = {quota->cpus, quota->throttled_periods, quota->throttled_ns};
  host.link = link();
  host.shared_memory = machine::shared_memory();
  host.answered = server_ ? answered() : 0;
  if (background_) host.background = {background_->counters(), task_.background.payload_bytes};
  return host;
}

void End::refuse(const std::vector<realtime::Refusal>& refusals) {
  for (const auto& [asked, found, remedy] : refusals)
    if (std::ranges::count(refusals_, asked, &record::Refusal::asked) == 0)
      refusals_.push_back({asked, found, remedy});
}

record::Thread End::during(const transport::Thread& thread, const realtime::ThreadState& now) const {
  const auto found = before_.find(thread.tid);
  const auto before = found == before_.end() ? realtime::ThreadState{} : found->second;
  const auto counter = instructions_.find(thread.tid);
  return {.role = thread.role,
          .name = thread.name,
          .tid = thread.tid,
          .policy = realtime::word_of(now.policy),
          .priority = now.priority,
          .cpus = now.cpus,
          .minor_faults = now.minor_faults - before.minor_faults,
          .major_faults = now.major_faults - before.major_faults,
          .voluntary_switches = now.voluntary_switches - before.voluntary_switches,
          .involuntary_switches = now.involuntary_switches - before.involuntary_switches,
          .cpu_time_us = static_cast<double>((now.cpu_time - before.cpu_time).count()) / 1e3,
          .instructions = counter == instructions_.end() ? std::nullopt : counter->second.value()};
}

record::Losses End::losses() {
  const auto now = endpoint().losses();
  return {since(losses_before_.on_the_way, now.on_the_way),
          since(losses_before_.overwritten, now.overwritten)};
}

// Messages that certainly passed this end in both directions.
std::uint64_t End::answered() const {
  if (server_) return server_->answered() - answered_before_;
  if (!client_) return 0;
  const auto counters = client_->counters();
  return counters.on_time + counters.late;
}

record::Link End::link() const {
  if (!traffic_before_) return {};
  auto link = record::read<record::Link>(
      machine::since(*traffic_before_, task_.config.interface,
                     answered() * message::least_frame_bytes(task_.client.payload_bytes)));
  link.interface = task_.config.interface;
  for (const auto& [from_ns, to_ns, taken] : link_watch_->downs())
    link.down.push_back({from_ns, to_ns != 0 ? std::optional(to_ns) : std::nullopt, taken});
  return link;
}

std::string lacks_address(const std::string& name, const std::string& master,
                          const std::vector<machine::Interface>& all) {
  if (master.empty())
    return fmt::format("interface '{0}' has no IPv4 address. Fix: sudo ip address add A.B.C.D/N dev {0}",
                       name);
  const auto found = std::ranges::find(all, master, &machine::Interface::name);
  if (found == all.end() || found->addresses.empty())
    return fmt::format(
        "interface '{0}' is a port of {1}, and neither has an IPv4 address. Fix: interface: {1}, and sudo ip "
        "address add A.B.C.D/N dev {1}",
        name, master);
  return fmt::format("interface '{0}' is a port of {1}, which has the address {2}. Fix: interface: {1}", name,
                     master, fmt::join(found->addresses, ", "));
}

std::string lacks_memory(std::istream& meminfo, const std::optional<machine::GroupMemory>& group) {
  std::uint64_t total = 0, available = 0, kilobytes = 0;
  for (std::string word; meminfo >> word;) {
    if (word == "MemTotal:" && meminfo >> kilobytes) total = kilobytes * 1024;
    if (word == "MemAvailable:" && meminfo >> kilobytes) available = kilobytes * 1024;
  }
  if (group && group->left_bytes() < std::min(available, own_locked_bytes))
    return fmt::format(
        "an end with locked memory needs {} MiB or more. Its control group has {} MiB left of {} MiB. Fix: "
        "raise the group's limit (MemoryMax of systemd, --memory of docker), or set realtime.lock-memory: "
        "off",
        own_locked_bytes / mebibyte, group->left_bytes() / mebibyte, group->limit_bytes / mebibyte);
  const auto reserve = std::min(total / 20, most_reserve);
  if (total == 0 || available >= locked_bytes + reserve) return "";
  return fmt::format(
      "an end with locked memory needs {} MiB. This machine has {} MiB free and reserves {} MiB. Fix: run "
      "fewer components on it, stop other programs, or set realtime.lock-memory: off",
      locked_bytes / mebibyte, available / mebibyte, reserve / mebibyte);
}

}  // namespace ontime::agent

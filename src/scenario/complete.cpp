// SPDX-License-Identifier: Apache-2.0
// Completes and checks a run whose keys are set.
#include "scenario/complete.hpp"

#include <algorithm>
#include <cstdlib>
#include <stdexcept>
#include <string_view>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "spelling/spelling.hpp"
#include "transport/dds.hpp"
#include "transport/shipped.hpp"

namespace ontime::scenario {
namespace {

using conditions::number_of, conditions::Security, conditions::text_of;
using realtime::Policy;
using transport::Capabilities;
using Text = const std::string&;

constexpr std::size_t max_topic_length = 247;  // RMW_TOPIC_MAX_NAME_LENGTH

std::string whole_topic(const Run& run, Text name) {
  if (name.starts_with('/')) return name;
  return fmt::format("{}{}/{}", run.ros_namespace.starts_with('/') ? "" : "/",
                     run.ros_namespace == "/" ? "" : run.ros_namespace, name);
}

void complete_topics(Run& run) {
  auto& config = run.task.config;
  config.ping_topic = whole_topic(run, run.ping_topic);
  config.pong_topic = whole_topic(run, run.pong_topic);
  check_topics(config);
}

void complete_isolation(const Run& run) {
  const auto& wish = run.isolation;
  if (wish.interrupts && wish.cpus.empty())
    refuse("isolation.interrupts needs isolation.cpus: the CPUs to keep free of interrupts");
  for (const auto* name : {"irq-cpus", "workqueue-cpus"})
    if (wish.interrupts && run.kernel.contains(name))
      refuse("isolation.interrupts sets kernel.{}, which is also stated: leave out one", name);
  if (wish.limits() && run.traffic.priority > 0)
    refuse(
        "quota and weight do not affect a real-time priority: leave out traffic.priority, or "
        "isolation.load-quota and isolation.load-weight");
  if (wish.cpus.empty()) return;
  const auto kept = realtime::cpus_of(wish.cpus).value_or(std::vector<int>{});
  for (const auto& [role, thread] : run.task.realtime.threads)
    for (const int cpu : thread.cpus)
      if (std::ranges::find(kept, cpu) == kept.end())
        refuse("threads of role {} cannot run on CPU {}: isolation.cpus restricts both ends to {}", role, cpu,
               wish.cpus);
}

// Whether a transport is known to have (or lack) this capability.
bool is_known(Text transport, bool Capabilities::*what, bool has = true) {
  const auto can = transport::declared(transport);
  return can && (*can).*what == has;
}

// Frames without an IP header reach no socket, and a transport without topics knows none to answer on.
bool may_reach(const Capabilities& one, const Capabilities& other) {
  return one.below_ip == other.below_ip && one.topics == other.topics;
}

void check_ends(const Run& run) {
  const auto &controller = run.task.transport, &component = run.component_transport;
  if (component.empty()) return;
  const auto can = transport::declared(controller), others = transport::declared(component);
  if (!can || !others || may_reach(*can, *others)) return;
  const bool is_below_ip = can->below_ip != others->below_ip;
  const bool is_controller = is_below_ip ? can->below_ip : !can->topics;
  std::vector<std::string_view> alike;
  for (const auto& one : transport::all_shipped)
    if (may_reach(*can, one.can)) alike.push_back(one.name);
  refuse("{} cannot reach {} on the component: {} has no {}. Fix: leave out component.transport{}",
         controller, component, is_controller ? controller : component, is_below_ip ? "IP header" : "topics",
         alike.empty() ? "" : fmt::format(", or use one of: {}", fmt::join(alike, ", ")));
}

// Checked before the first run, so that a misspelt option does not fail after hours.
void check_options(const Run& run) {
  const auto check = [](Text name, const std::map<std::string, std::string>& options) {
    const auto known = transport::declared_options(name);
    const auto why = known ? transport::unknown_option(name, *known, options) : "";
    if (!why.empty()) throw std::invalid_argument(why);
  };
  check(run.task.transport, run.task.config.options);
  if (!run.component_transport.empty()) check(run.component_transport, run.component_options);
}

void check_payload(const Run& run) {
  const auto& task = run.task;
  const auto beside = task.background.topics > 0 ? task.background.payload_bytes : 0;
  const auto largest = std::max(task.config.max_payload_bytes, beside);
  for (const auto& name : {task.transport, run.component_transport})
    if (const auto can = transport::declared(name); can && largest > can->max_payload_bytes)
      refuse("transport {} carries at most {} bytes of payload; {} were requested", name,
             can->max_payload_bytes, largest);
}

}  // namespace

int domain_of_environment() {
  const char* const id = std::getenv("ROS_DOMAIN_ID");  // NOLINT(concurrency-mt-unsafe): no thread sets it
  if (id == nullptr || *id == '\0') return 0;
  try {
    return static_cast<int>(number_of(id, 0, transport::dds::max_domain));
  } catch (const std::invalid_argument& error) {
    refuse("ROS_DOMAIN_ID: {}; correct it, unset it, or set the domain", error.what());
  }
}

void check_topics(const transport::Config& config) {
  for (const auto& topic : {config.ping_topic, config.pong_topic})
    if (topic.size() > max_topic_length)
      refuse("topic {} is longer than {} characters, the limit of ROS 2", topic, max_topic_length);
  if (config.ping_topic == config.pong_topic)
    refuse("topics.ping and topics.pong are both {}: use two names", config.ping_topic);
}

void check_transports(const Run& run) {
  for (const auto& name : {run.task.transport, run.component_transport}) {
    if (name.empty() || transport::shipped(name) != nullptr) continue;
    auto known = transport::available();
    if (std::ranges::find(known, name) != known.end()) continue;
    for (const auto& one : transport::all_shipped)
      if (std::ranges::find(known, one.name) == known.end()) known.emplace_back(one.name);
    refuse("unknown transport '{}'{}; known: {}", name, spelling::suggestion(name, known),
           fmt::join(known, ", "));
  }
}

bool is_below_ip(Text transport) { return is_known(transport, &Capabilities::below_ip); }
bool is_past_the_kernel(Text transport) { return is_known(transport, &Capabilities::past_the_kernel); }
bool has_no_topics(Text transport) { return is_known(transport, &Capabilities::topics, false); }
bool has_no_qos(Text transport) { return is_known(transport, &Capabilities::qos, false); }
bool any_past_the_kernel(const Run& run) {
  return is_past_the_kernel(run.task.transport) || is_past_the_kernel(run.component_transport);
}

std::string other_transports(bool Capabilities::*what, bool has) {
  std::vector<std::string_view> names;
  for (const auto& one : transport::all_shipped)
    if (one.can.*what == has) names.push_back(one.name);
  return fmt::format("another transport ({})", fmt::join(names, ", "));
}

std::string why_not_by(Text transport, const Capabilities& can, const Run& run,
                       const conditions::Wire& wire) {
  const auto in_kernel = [] { return other_transports(&Capabilities::past_the_kernel, false); };
  if (can.past_the_kernel && run.explain)
    return fmt::format(
        "explain cannot follow {}: the kernel's tracepoints do not see its packets. Leave out explain, or "
        "use {}",
        transport, in_kernel());
  if (can.past_the_kernel && run.faults.any())
    return fmt::format(
        "{} bypasses the packet filter and queueing disciplines that make link faults: leave out link, or "
        "use {}",
        transport, in_kernel());
  if (can.past_the_kernel && wire.bits_per_s > 0)
    return fmt::format(
        "{} bypasses the interface's queueing disciplines, and wire.rate is one: leave out wire.rate, or "
        "use {}",
        transport, in_kernel());
  if (can.below_ip && run.faults.dscp)
    return fmt::format(
        "link.dscp needs an IP header, and messages over {} have none: leave it out, or use {}", transport,
        other_transports(&Capabilities::below_ip, false));
  return "";
}

std::string why_not_by_its_transports(const Run& run, const conditions::Wire& wire) {
  for (const auto& name : {run.task.transport, run.component_transport})
    if (const auto can = transport::declared(name))
      if (auto why = why_not_by(name, *can, run, wire); !why.empty()) return why;
  return "";
}

constexpr std::string_view options_path = "options.", component_options_path = "component.options.";

bool is_option(Text path) {
  const auto begins_so = [&](auto prefix) { return path.starts_with(prefix) && path.size() > prefix.size(); };
  return begins_so(options_path) || begins_so(component_options_path);
}

void set_option(Run& run, Text path, Text value) {
  if (path.starts_with(component_options_path))
    run.component_options[path.substr(component_options_path.size())] = value;
  else
    run.task.config.options[path.substr(options_path.size())] = value;
}

Together together(const Run& run, const Hosts& hosts) {
  Together runs;
  for (const auto& component : hosts.components) runs.push_back(with_component(run, component.name));
  return runs;
}

Run with_component(Run run, const std::string& name) {
  const auto own = std::ranges::find(run.own, name, &Run::component);
  if (own != run.own.end()) {
    auto found = std::move(*own);
    found.repetition = run.repetition;
    found.step = run.step;
    run = std::move(found);
  }
  run.own.clear();
  run.component = name;
  if (!is_named(run)) return run;
  run.variant += fmt::format("{}component {}", run.variant.empty() ? "" : ", ", name);
  run.varied.emplace_back("component", name);
  auto& config = run.task.config;
  if (has_no_topics(run.task.transport)) return run;  // its pongs are told apart by address
  for (auto* topic : {&config.ping_topic, &config.pong_topic}) topic->insert(topic->rfind('/'), "/" + name);
  check_topics(config);
  return run;
}

void complete(Run& run) {
  auto& client = run.task.client;
  if (const auto& own = run.listening; !own.any() && (own.deadline || own.period || own.age))
    refuse("listen.deadline, listen.period and listen.age need listen.topics");
  if (run.task.transport.empty()) refuse("no transport is set. Fix: transport: udp");
  if (run.component_transport.empty() && !run.component_options.empty())
    refuse("component.options needs component.transport");
  if (run.explain && run.component_restart)
    refuse(
        "explain identifies the server's threads by id, and a restart changes the ids: leave out explain or "
        "component.restart");
  if (run.security != Security::off && is_known(run.task.transport, &Capabilities::security, false))
    refuse("transport {} has no DDS Security: leave out security, or use {}", run.task.transport,
           other_transports(&Capabilities::security, true));
  if (run.security != Security::off && !run.component_transport.empty() &&
      run.component_transport != run.task.transport)
    refuse(
        "security needs the same transport at both ends: DDS of two vendors may not authenticate "
        "each other. Leave out security or component.transport ({})",
        run.component_transport);
  if (const auto why = why_not_by_its_transports(run); !why.empty()) throw std::invalid_argument(why);
  if (has_no_qos(run.task.transport)) run.task.config.qos = {};  // which would look like a condition
  run.task.config.domain = run.domain ? *run.domain : domain_of_environment();
  complete_topics(run);
  complete_network(run);
  complete_background(run);
  complete_isolation(run);
  check_ends(run);
  check_options(run);
  check_payload(run);
  if (client.deadline > client.timeout)
    refuse("deadline ({}) is longer than timeout ({}): no message could be late", text_of(client.deadline),
           text_of(client.timeout));
  if (client.schedule != roundtrip::Schedule::back_to_back && client.period > client.duration)
    refuse("period ({}) is longer than duration ({}): state a duration of many periods",
           text_of(client.period), text_of(client.duration));
  if (client.schedule == roundtrip::Schedule::fixed && client.timeout / client.period > 500'000)
    refuse("more than 500000 messages could be in flight: use a longer period or a shorter timeout");
  for (auto& [role, thread] : run.task.realtime.threads) {
    const bool has_priority = thread.policy == Policy::fifo || thread.policy == Policy::round_robin;
    if (thread.priority != 0 && !has_priority)
      refuse("threads of role {}: a priority needs policy fifo or rr", role);
    if (thread.policy != Policy::deadline) continue;
    thread.period = thread.deadline = client.period;
    thread.runtime = client.period / 10;
  }
}

}  // namespace ontime::scenario

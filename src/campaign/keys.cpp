// SPDX-License-Identifier: Apache-2.0
// What can be said of a run: one table, from which scenario files, flags and --help are made.
#include "campaign/keys.hpp"

#include <algorithm>
#include <cstdlib>
#include <limits>
#include <stdexcept>
#include <string_view>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "campaign/campaign.hpp"
#include "campaign/isolation.hpp"
#include "campaign/kernel.hpp"

namespace ontime::campaign {
namespace {

using realtime::Policy;
using realtime::ThreadSettings;
using Text = const std::string&;

using namespace std::chrono_literals;

constexpr int paper_priority = 80;             // of what a message passes through
constexpr int background_priority = 70;        // of a middleware's other threads
constexpr std::int64_t max_domain = 232;       // the last one whose ports exist
constexpr std::size_t max_topic_length = 247;  // RMW_TOPIC_MAX_NAME_LENGTH
constexpr std::uint64_t max_payload_bytes = std::uint64_t{1} << 30U;
const std::vector<std::string> message_roles{"send", "receive", "delivery"};
const std::vector<std::string> background_roles{"discovery", "timer", "other"};

// What idle states are limited by: a whole number of microseconds, as the kernel takes it.
std::optional<std::chrono::microseconds> cpu_latency_of(Text text) {
  if (text == "any") return {};
  const auto latency = duration_of(text);
  const auto whole = std::chrono::duration_cast<std::chrono::microseconds>(latency);
  if (whole.count() < 0 || whole.count() > std::numeric_limits<std::int32_t>::max() || whole != latency)
    throw std::invalid_argument(
        fmt::format("'{}' is not a whole number of microseconds from 0 to 2147483647", text));
  return whole;
}

// Of a stress-ng worker, for which none would mean stress-ng's own choice.
std::uint64_t size_of(Text text) {
  const auto bytes = bytes_of(text);
  if (bytes == 0) throw std::invalid_argument(fmt::format("'{}' is no size", text));
  return bytes;
}

// As rmw validates a topic's whole name, and a namespace: parts between slashes, each like a variable's name.
bool is_ros_name(std::string_view name) {
  const auto is_letter = [](char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_'; };
  const auto is_digit = [](char c) { return c >= '0' && c <= '9'; };
  if (name.starts_with('/')) name.remove_prefix(1);
  char before = '/';
  for (const char c : name) {
    const bool begins_part = before == '/';
    if (!is_letter(c) && (begins_part || !(is_digit(c) || c == '/'))) return false;
    before = c;
  }
  return before != '/';
}

std::string ros_name_of(Text text) {
  if (!is_ros_name(text))
    throw std::invalid_argument(fmt::format(
        "'{}' is no name of ROS 2: parts of letters, digits and _ that begin with no digit, with / between",
        text));
  return text;
}

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

// Every user of ROS 2 says the domain so, of its nodes and of what is to talk to them.
int domain_of_environment() {
  const char* const id = std::getenv("ROS_DOMAIN_ID");  // NOLINT(concurrency-mt-unsafe): nobody sets it
  if (id == nullptr || *id == '\0') return 0;
  try {
    return static_cast<int>(number_of(id, 0, max_domain));
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument(
        fmt::format("ROS_DOMAIN_ID: {}; set it right, unset it, or state the domain", error.what()));
  }
}

bool yes_or_no(Text text) {
  if (text == "true" || text == "on" || text == "yes") return true;
  if (text == "false" || text == "off" || text == "no") return false;
  throw std::invalid_argument(fmt::format("'{}' is neither on nor off", text));
}

// The paper's settings, and a latency request that it did not have: everything else builds on them.
void set_realtime_on(Run& run) {
  auto& settings = run.task.realtime;
  if (settings.on) return;
  settings.on = settings.lock_memory = true;
  settings.cpu_latency = std::chrono::microseconds(0);
  for (const auto& role : message_roles)
    settings.threads[role] = {.policy = Policy::fifo, .priority = paper_priority, .cpus = {}};
  for (const auto& role : background_roles)
    settings.threads[role] = {.policy = Policy::fifo, .priority = background_priority, .cpus = {}};
}

void set_realtime(Run& run, Text text) {
  run.realtime_refused = !yes_or_no(text);
  if (run.realtime_refused)
    run.task.realtime = {};
  else
    set_realtime_on(run);
}

using SetSettings = std::function<void(agent::RealtimeSettings&, Text)>;
std::function<void(Run&, Text)> realtime_setting(SetSettings set) {
  return [set = std::move(set)](Run& run, Text text) {
    agent::RealtimeSettings checked = run.task.realtime;  // a wrong word is wrong also where it has no effect
    set(checked, text);
    if (run.realtime_refused) return;
    set_realtime_on(run);
    set(run.task.realtime, text);
  };
}

void set_policy(ThreadSettings& thread, Text text) {
  thread.policy = one_of(realtime::policy_of(text), text, "other, fifo, rr, deadline");
  const bool has_priority = thread.policy == Policy::fifo || thread.policy == Policy::round_robin;
  if (!has_priority) thread.priority = 0;
  if (has_priority && thread.priority == 0) thread.priority = paper_priority;
}
void set_priority(ThreadSettings& thread, Text text) {
  thread.priority = static_cast<int>(number_of(text, 1, 99));
}
void set_cpus(ThreadSettings& thread, Text text) {
  thread.cpus = one_of(realtime::cpus_of(text), text, "lists of CPUs such as 1 or 0-1,3");
}

void add_thread_keys(std::vector<Key>& keys, const std::string& path, const std::string& flag,
                     const std::vector<std::string>& roles, const std::string& whose) {
  const auto each = [&roles](void (*set)(ThreadSettings&, Text)) {
    return realtime_setting([set, roles](agent::RealtimeSettings& settings, Text text) {
      for (const auto& role : roles) set(settings.threads[role], text);
    });
  };
  const auto both = Key::For::both;
  keys.push_back({path + ".policy", flag + "policy", "other|fifo|rr|deadline", "policy of " + whose, both,
                  each(set_policy)});
  keys.push_back(
      {path + ".priority", flag + "priority", "1-99", "priority of " + whose, both, each(set_priority)});
  keys.push_back({path + ".cpus", flag + "cpus", "LIST", "CPU affinity of " + whose, both, each(set_cpus)});
}  // NOLINT(clang-analyzer-cplusplus.NewDeleteLeaks): it loses sight of what a std::function holds

void add_load_keys(std::vector<Key>& keys, const std::string& host, background::Workers Run::*load) {
  const auto client = Key::For::client;
  const auto add = [&](const std::string& kind, int background::Workers::*workers, const std::string& help) {
    keys.push_back({fmt::format("load.{}.{}", host, kind), "", "N", help, client, [=](Run& run, Text text) {
                      (run.*load).*workers = static_cast<int>(number_of(text, 0, 1024));
                    }});
  };
  const auto add_bytes = [&](const std::string& kind, std::uint64_t background::Workers::*bytes,
                             const std::string& help) {
    keys.push_back({fmt::format("load.{}.{}", host, kind), "", "SIZE", help, client,
                    [=](Run& run, Text text) { (run.*load).*bytes = size_of(text); }});
  };
  add("cpu", &background::Workers::cpu, "stress-ng workers that compute");
  add("vm", &background::Workers::vm, "stress-ng workers that write to memory");
  add("io", &background::Workers::io, "stress-ng workers that call sync(2)");
  add("hdd", &background::Workers::hdd, "stress-ng workers that write files");
  add_bytes("vm-bytes", &background::Workers::vm_bytes, "memory of each vm worker");
  add_bytes("hdd-bytes", &background::Workers::hdd_bytes, "file size of each hdd worker");
}

std::vector<Key> all_keys() {
  const auto client = Key::For::client, both = Key::For::both;
  std::vector<Key> keys{
      {"title", "", "TEXT", "what the run is, in words", client,
       [](Run& run, Text text) { run.title = text; }},
      {"adds-to", "", "ID", "the run that is the layer below this one, for `ontime report --layers`", client,
       [](Run& run, Text text) { run.adds_to = text; }},
      {"search", "", "KEY",
       "the key whose list of values, from the gentlest on, is tried for the first misses", client,
       [](Run& run, Text text) { run.step.key = text; }},
      {"count-instructions", "", "on|off", "of each thread, where the CPU has a counter for it", client,
       [](Run& run, Text text) { run.task.count_instructions = yes_or_no(text); }},
      {"explain", "--explain", "on|off",
       "keep what the kernel did around late, lost and the worst messages, for `ontime explain`; needs root",
       both, [](Run& run, Text text) { run.explain = yes_or_no(text); }},
      {"transport", "--transport", "NAME",
       "ethernet, xdp, udp, cyclonedds, fastdds, or another that is installed", both,
       [](Run& run, Text text) { run.task.transport = text; }},
      {"component.transport", "", "NAME", "of the answering end, where it is another", client,
       [](Run& run, Text text) { run.component_transport = text; }},
      {"component.restart", "", "on|off", "start the answering end again if it dies during the run", client,
       [](Run& run, Text text) { run.component_restart = yes_or_no(text); }},
      {"payload", "--payload", "SIZE", "bytes beside the sequence number: 500 B; for pong at most: 60 kB",
       both,
       [](Run& run, Text text) {
         run.task.client.payload_bytes = run.task.config.max_payload_bytes = payload_of(text);
       }},
      {"schedule", "--schedule", "next-free|fixed|back-to-back", "when the next message is sent: next-free",
       client,
       [](Run& run, Text text) {
         run.task.client.schedule =
             one_of(roundtrip::schedule_of(text), text, "next-free, fixed, back-to-back");
       }},
      {"period", "--period", "TIME", "of sending: 10 ms", client,
       [](Run& run, Text text) {
         const auto period = positive_duration(text, 1h);
         if (period < std::chrono::microseconds(10))
           throw std::invalid_argument(
               fmt::format("'{}' is too short: the least period is 10 us; for as fast as "
                           "possible use schedule back-to-back",
                           text));
         run.task.client.period = period;
       }},
      {"deadline", "--deadline", "TIME", "a longer round trip is late: 10 ms", client,
       [](Run& run, Text text) { run.task.client.deadline = positive_duration(text, 1h); }},
      {"timeout", "--timeout", "TIME", "a message without an answer for longer is lost: 500 ms", client,
       [](Run& run, Text text) { run.task.client.timeout = positive_duration(text, 1h); }},
      {"duration", "--duration", "TIME", "of sending, warm-up not counted: 10 s", client,
       [](Run& run, Text text) { run.task.client.duration = positive_duration(text); }},
      {"warm-up", "--warm-up", "N", "answers before the first counted message: 10", client,
       [](Run& run, Text text) {
         run.task.client.warm_up = static_cast<std::uint64_t>(number_of(text, 1, 1'000'000));
       }},
      {"receive", "--receive", "listener|waitset",
       "on the middleware's thread, or on one of ours that waits: listener", both,
       [](Run& run, Text text) {
         run.task.config.receive = one_of(agent::receive_of(text), text, "listener, waitset");
       }},
      {"domain", "--domain", "0-232", "DDS domain, and for udp port 7900 + domain: $ROS_DOMAIN_ID, or 0",
       both, [](Run& run, Text text) { run.domain = static_cast<int>(number_of(text, 0, max_domain)); }},
      {"namespace", "--namespace", "NAME", "of the topics, as ROS 2 names it, such as /robot: /", both,
       [](Run& run, Text text) { run.ros_namespace = text == "/" ? text : ros_name_of(text); }},
      {"topics.ping", "--ping-topic", "NAME", "what the client writes: ping", both,
       [](Run& run, Text text) { run.ping_topic = ros_name_of(text); }},
      {"topics.pong", "--pong-topic", "NAME", "what the server answers on: pong", both,
       [](Run& run, Text text) { run.pong_topic = ros_name_of(text); }},
      {"qos.reliability", "--reliability", "best-effort|reliable", "quality of service: best-effort", both,
       [](Run& run, Text text) {
         run.task.config.qos.reliability = one_of(agent::reliability_of(text), text, "best-effort, reliable");
       }},
      {"qos.history", "--history", "keep-last|keep-all", "quality of service: keep-last", both,
       [](Run& run, Text text) {
         run.task.config.qos.history = one_of(agent::history_of(text), text, "keep-last, keep-all");
       }},
      {"qos.depth", "--depth", "N", "of keep-last: 1", both,
       [](Run& run, Text text) {
         run.task.config.qos.depth = static_cast<int>(number_of(text, 1, 1'000'000));
       }},
      {"qos.durability", "--durability", "volatile|transient-local", "quality of service: volatile", both,
       [](Run& run, Text text) {
         run.task.config.qos.durability =
             one_of(agent::durability_of(text), text, "volatile, transient-local");
       }},
      {"security", "", "off|authenticate|sign|encrypt",
       "DDS Security: whether both ends show who they are, and what becomes of each payload: off", client,
       [](Run& run, Text text) {
         run.security = one_of(security::level_of(text), text, "off, authenticate, sign, encrypt");
       }},
      {"realtime", "--realtime", "on|off",
       "locked memory, no deep idle states, SCHED_FIFO 80 for the message's way and 70 for a middleware's "
       "other threads",
       both, set_realtime},
      {"realtime.lock-memory", "--lock-memory", "on|off", "lock and touch all memory", both,
       realtime_setting([](auto& settings, Text text) { settings.lock_memory = yes_or_no(text); })},
      {"realtime.cpu-latency", "--cpu-latency", "TIME|any", "longest exit latency of an idle state", both,
       realtime_setting([](auto& settings, Text text) { settings.cpu_latency = cpu_latency_of(text); })},
  };
  add_thread_keys(keys, "realtime", "--", message_roles, "the threads a message passes through");
  for (const auto& roles : {message_roles, background_roles})
    for (const auto& role : roles)
      add_thread_keys(keys, "realtime." + role, "--" + role + "-", {role}, "threads of role " + role);
  add_load_keys(keys, "controller", &Run::controller_load);
  add_load_keys(keys, "component", &Run::component_load);
  for (auto& key : network_keys()) keys.push_back(std::move(key));
  for (auto& key : neighbour_keys()) keys.push_back(std::move(key));
  for (auto& key : isolation_keys()) keys.push_back(std::move(key));
  for (auto& key : kernel_keys()) keys.push_back(std::move(key));
  return keys;
}

}  // namespace

std::size_t payload_of(Text text) {
  const auto bytes = bytes_of(text);
  if (bytes > max_payload_bytes)
    throw std::invalid_argument(fmt::format("'{}' is too large: at most 1 GiB", text));
  return bytes;
}

void check_topics(const transport::Config& config) {
  for (const auto& topic : {config.ping_topic, config.pong_topic})
    if (topic.size() > max_topic_length)
      throw std::invalid_argument(
          fmt::format("the topic {} is longer than {} characters, which ROS 2 takes no more of", topic,
                      max_topic_length));
  if (config.ping_topic == config.pong_topic)
    throw std::invalid_argument(
        fmt::format("topics.ping and topics.pong are both {}: name two", config.ping_topic));
}

const std::vector<Key>& keys() {
  static const auto keys = all_keys();
  return keys;
}

bool is_below_ip(const std::string& transport) {
  return transport == "ethernet" || is_past_the_kernel(transport);
}

bool is_past_the_kernel(const std::string& transport) { return transport == "xdp"; }

bool any_past_the_kernel(const Run& run) {
  return is_past_the_kernel(run.task.transport) || is_past_the_kernel(run.component_transport);
}

constexpr std::string_view options_path = "options.", component_options_path = "component.options.";

bool is_option(Text path) {
  for (const auto prefix : {options_path, component_options_path})
    if (path.starts_with(prefix) && path.size() > prefix.size()) return true;
  return false;
}

void set_option(Run& run, Text path, Text value) {
  if (path.starts_with(component_options_path))
    run.component_options[path.substr(component_options_path.size())] = value;
  else
    run.task.config.options[path.substr(options_path.size())] = value;
}

Run with_component(Run run, const std::string& name) {
  const auto own =
      std::find_if(run.own.begin(), run.own.end(), [&](const Run& one) { return one.component == name; });
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
  auto& config = run.task.config;
  if (run.task.transport == "udp") return run;  // it has no topics: its pongs are told apart by address
  for (auto* topic : {&config.ping_topic, &config.pong_topic}) topic->insert(topic->rfind('/'), "/" + name);
  check_topics(config);
  return run;
}

std::string common_to_all(Text path) {
  constexpr std::pair<std::string_view, const char*> reasons[] = {
      {"id", "it is of the run, which is one for all components"},
      {"title", "it is of the run, which is one for all components"},
      {"adds-to", "it is of the run, which is one for all components"},
      {"search", "it is of the run: say search: NAME.KEY there"},
      {"duration", "all are measured at the same time, for as long"},
      {"explain", "the kernels' events are kept for all, or for none"},
      {"kernel.", "it is of machines, and the controller's is one for all"},
      {"isolation.", "it is of machines, and the controller's is one for all"},
      {"load.controller.", "the controller is one for all"}};
  for (const auto& [key, reason] : reasons)
    if (path == key || (key.ends_with('.') && path.starts_with(key))) return reason;
  return "";
}

void complete(Run& run) {
  auto& client = run.task.client;
  if (run.task.transport.empty()) throw std::invalid_argument("no transport is stated");
  if (run.component_transport.empty() && !run.component_options.empty())
    throw std::invalid_argument("component.options need a component.transport that they are for");
  if (run.explain && run.component_restart)
    throw std::invalid_argument(
        "explain knows a component's threads by their numbers, of which one that is started again has "
        "others: leave "
        "out explain, or component.restart");
  if (run.security != security::Level::off &&
      (run.task.transport == "udp" || is_below_ip(run.task.transport)))
    throw std::invalid_argument(
        fmt::format("transport {} has no DDS Security; cyclonedds and fastdds have: leave out security",
                    run.task.transport));
  if (run.security != security::Level::off && !run.component_transport.empty() &&
      run.component_transport != run.task.transport)
    throw std::invalid_argument(fmt::format(
        "security needs one transport at both ends, for the DDS of two vendors do not always let each "
        "other in: leave out security, or component.transport ({})",
        run.component_transport));
  if (run.explain && any_past_the_kernel(run))
    throw std::invalid_argument(
        "explain cannot follow what xdp sends, for the kernel's tracepoints do not see it: leave out "
        "explain, or take "
        "ethernet");
  run.task.config.domain = run.domain ? *run.domain : domain_of_environment();
  complete_topics(run);
  complete_network(run);
  complete_neighbours(run);
  complete_isolation(run);
  if (client.deadline > client.timeout)
    throw std::invalid_argument(
        fmt::format("the deadline ({}) is longer than the time-out ({}): nothing could ever be late",
                    text_of(client.deadline), text_of(client.timeout)));
  if (client.schedule == roundtrip::Schedule::fixed && client.timeout / client.period > 500'000)
    throw std::invalid_argument(
        "more than 500000 messages may be in flight: lengthen the period or shorten the time-out");
  for (auto& [role, thread] : run.task.realtime.threads) {
    const bool has_priority = thread.policy == Policy::fifo || thread.policy == Policy::round_robin;
    if (thread.priority != 0 && !has_priority)
      throw std::invalid_argument(
          fmt::format("threads of role {}: a priority needs policy fifo or rr", role));
    if (thread.policy != Policy::deadline) continue;
    thread.period = thread.deadline = client.period;
    thread.runtime = client.period / 10;
  }
}

}  // namespace ontime::campaign

// SPDX-License-Identifier: Apache-2.0
// Orders and their words, to and from JSON.
#include <array>
#include <bit>
#include <cstring>
#include <utility>

#include "agent/agent.hpp"

namespace ontime::agent {
namespace {

using nlohmann::json;
using transport::Durability;
using transport::History;
using transport::Receive;
using transport::Reliability;
using transport::Role;

template <typename Value, std::size_t N>
using Words = std::array<std::pair<const char*, Value>, N>;

constexpr Words<Role, 2> roles{{{"client", Role::client}, {"server", Role::server}}};
constexpr Words<Receive, 2> receives{{{"listener", Receive::listener}, {"waitset", Receive::waitset}}};
constexpr Words<Reliability, 2> reliabilities{
    {{"best-effort", Reliability::best_effort}, {"reliable", Reliability::reliable}}};
constexpr Words<History, 2> histories{{{"keep-last", History::keep_last}, {"keep-all", History::keep_all}}};
constexpr Words<Durability, 2> durabilities{
    {{"volatile", Durability::volatile_}, {"transient-local", Durability::transient_local}}};

template <typename Value, std::size_t N>
std::optional<Value> find(const Words<Value, N>& words, const std::string& word) {
  for (const auto& [name, value] : words)
    if (word == name) return value;
  return {};
}

template <typename Value, std::size_t N>
const char* find(const Words<Value, N>& words, Value wanted) {
  for (const auto& [name, value] : words)
    if (value == wanted) return name;
  return "";
}

json settings_json(const realtime::ThreadSettings& settings) {
  json result{{"policy", realtime::word_of(settings.policy)}, {"priority", settings.priority}};
  if (!settings.cpus.empty()) result["cpus"] = realtime::list_of(settings.cpus);
  if (settings.policy == realtime::Policy::deadline) {
    result["runtime_ns"] = settings.runtime.count();
    result["deadline_ns"] = settings.deadline.count();
    result["period_ns"] = settings.period.count();
  }
  return result;
}

realtime::ThreadSettings settings_of(const json& from) {
  realtime::ThreadSettings settings;
  settings.policy = realtime::policy_of(from.at("policy")).value();
  settings.priority = from.at("priority");
  settings.cpus = realtime::cpus_of(from.value("cpus", "")).value_or(std::vector<int>{});
  settings.runtime = std::chrono::nanoseconds(from.value("runtime_ns", 0LL));
  settings.deadline = std::chrono::nanoseconds(from.value("deadline_ns", 0LL));
  settings.period = std::chrono::nanoseconds(from.value("period_ns", 0LL));
  return settings;
}

json to_json(const roundtrip::NeighbourOptions& options) {
  return {{"topics", options.topics},
          {"where", roundtrip::word_of(options.where)},
          {"payload_bytes", options.payload_bytes},
          {"period_ns", options.period.count()},
          {"reliability", find(reliabilities, options.reliability)},
          {"there", options.there},
          {"back", options.back},
          {"priority", options.priority},
          {"callback_ns", options.callback.count()},
          {"session", options.session}};
}

roundtrip::NeighbourOptions neighbours_of(const json& from) {
  return {.topics = from.at("topics"),
          .where = roundtrip::where_of(from.at("where")).value(),
          .payload_bytes = from.at("payload_bytes"),
          .period = std::chrono::nanoseconds(from.at("period_ns").get<std::int64_t>()),
          .reliability = find(reliabilities, from.at("reliability")).value(),
          .there = from.at("there"),
          .back = from.at("back"),
          .priority = from.at("priority"),
          .callback = std::chrono::nanoseconds(from.at("callback_ns").get<std::int64_t>()),
          .session = from.at("session")};
}

RealtimeSettings realtime_of(const json& from) {
  RealtimeSettings settings;
  settings.on = from.at("on");
  settings.lock_memory = from.at("lock_memory");
  if (!from.at("cpu_latency_us").is_null())
    settings.cpu_latency = std::chrono::microseconds(from.at("cpu_latency_us").get<std::int64_t>());
  for (const auto& [role, thread] : from.at("threads").items()) settings.threads[role] = settings_of(thread);
  return settings;
}

}  // namespace

std::optional<Receive> receive_of(const std::string& word) { return find(receives, word); }
std::optional<Reliability> reliability_of(const std::string& word) { return find(reliabilities, word); }
std::optional<History> history_of(const std::string& word) { return find(histories, word); }
std::optional<Durability> durability_of(const std::string& word) { return find(durabilities, word); }
const char* word_of(Receive receive) { return find(receives, receive); }

json to_json(const transport::Qos& qos) {
  return {{"reliability", find(reliabilities, qos.reliability)},
          {"history", find(histories, qos.history)},
          {"depth", qos.depth},
          {"durability", find(durabilities, qos.durability)}};
}

void to_json(json& to, const RealtimeSettings& settings) {
  auto threads = json::object();
  for (const auto& [role, thread] : settings.threads) threads[role] = settings_json(thread);
  to = {{"on", settings.on},
        {"lock_memory", settings.lock_memory},
        {"cpu_latency_us", nullptr},
        {"threads", threads}};
  if (settings.cpu_latency) to["cpu_latency_us"] = settings.cpu_latency->count();
}

// Its parts, by name: they are many and all alike.
constexpr std::pair<const char*, std::string transport::Security::*> security_parts[] = {
    {"level", &transport::Security::level},
    {"identity_ca", &transport::Security::identity_ca},
    {"identity_certificate", &transport::Security::identity_certificate},
    {"private_key", &transport::Security::private_key},
    {"permissions_ca", &transport::Security::permissions_ca},
    {"governance", &transport::Security::governance},
    {"permissions", &transport::Security::permissions}};

json to_json(const std::optional<transport::Security>& security) {
  if (!security) return nullptr;
  json to;
  for (const auto& [name, part] : security_parts) to[name] = (*security).*part;
  return to;
}

std::optional<transport::Security> security_of(const json& from) {
  if (from.is_null()) return {};
  transport::Security security;
  for (const auto& [name, part] : security_parts) security.*part = from.at(name);
  return security;
}

void to_json(json& to, const Task& task) {
  const auto& client = task.client;
  to = {{"transport", task.transport},
        {"role", find(roles, task.config.role)},
        {"receive", word_of(task.config.receive)},
        {"qos", to_json(task.config.qos)},
        {"max_payload_bytes", task.config.max_payload_bytes},
        {"interface", task.config.interface},
        {"peers", task.config.peers},
        {"ping_topic", task.config.ping_topic},
        {"pong_topic", task.config.pong_topic},
        {"domain", task.config.domain},
        {"launch_ns", task.config.launch_ns},
        {"priority", task.config.priority ? json(*task.config.priority) : json()},
        {"options", task.config.options},
        {"security", to_json(task.config.security)},
        {"schedule", roundtrip::word_of(client.schedule)},
        {"period_ns", client.period.count()},
        {"deadline_ns", client.deadline.count()},
        {"timeout_ns", client.timeout.count()},
        {"duration_ns", client.duration.count()},
        {"payload_bytes", client.payload_bytes},
        {"warm_up", client.warm_up},
        {"neighbours", to_json(task.neighbours)},
        {"realtime", task.realtime},
        {"count_instructions", task.count_instructions}};
}

void from_json(const json& from, Task& task) {
  using std::chrono::nanoseconds;
  task.transport = from.at("transport");
  task.config.role = find(roles, from.at("role")).value();
  task.config.receive = receive_of(from.at("receive")).value();
  const auto& qos = from.at("qos");
  task.config.qos = {reliability_of(qos.at("reliability")).value(), history_of(qos.at("history")).value(),
                     qos.at("depth"), durability_of(qos.at("durability")).value()};
  task.config.max_payload_bytes = from.at("max_payload_bytes");
  task.config.interface = from.at("interface");
  task.config.peers = from.at("peers").get<std::vector<std::string>>();
  task.config.ping_topic = from.at("ping_topic");
  task.config.pong_topic = from.at("pong_topic");
  task.config.domain = from.at("domain");
  task.config.launch_ns = from.at("launch_ns");
  if (const auto& priority = from.at("priority"); !priority.is_null()) task.config.priority = priority;
  task.config.options = from.at("options").get<std::map<std::string, std::string>>();
  task.config.security = security_of(from.at("security"));
  task.client.schedule = roundtrip::schedule_of(from.at("schedule")).value();
  task.client.period = nanoseconds(from.at("period_ns").get<std::int64_t>());
  task.client.deadline = nanoseconds(from.at("deadline_ns").get<std::int64_t>());
  task.client.timeout = nanoseconds(from.at("timeout_ns").get<std::int64_t>());
  task.client.duration = nanoseconds(from.at("duration_ns").get<std::int64_t>());
  task.client.payload_bytes = from.at("payload_bytes");
  task.client.warm_up = from.at("warm_up");
  task.neighbours = neighbours_of(from.at("neighbours"));
  task.realtime = realtime_of(from.at("realtime"));
  task.count_instructions = from.at("count_instructions");
}

json to_json(const roundtrip::Counters& counters) {
  json to;
  for (const auto& [name, member] : roundtrip::counter_names) to[name] = counters.*member;
  to["trailing_due_ns"] = counters.trailing_due_ns;
  to["trailing_until_ns"] = counters.trailing_until_ns;
  return to;
}

json to_json(const roundtrip::NeighbourCounters& counters) {
  return {{"sent", counters.sent},
          {"refused", counters.refused},
          {"skipped_cycles", counters.skipped_cycles},
          {"received", counters.received},
          {"strays", counters.strays},
          {"overruns", counters.overruns}};
}

roundtrip::Counters counters_of(const json& from) {
  roundtrip::Counters counters;
  for (const auto& [name, member] : roundtrip::counter_names) counters.*member = from.at(name);
  counters.trailing_due_ns = from.at("trailing_due_ns");
  counters.trailing_until_ns = from.at("trailing_until_ns");
  return counters;
}

std::string sample_layout() {
  return std::to_string(sizeof(roundtrip::Sample)) +
         (std::endian::native == std::endian::little ? "le" : "be");
}

std::vector<roundtrip::Sample> samples_of(std::span<const std::uint8_t> bytes) {
  std::vector<roundtrip::Sample> samples(bytes.size() / sizeof(roundtrip::Sample));
  if (!samples.empty()) std::memcpy(samples.data(), bytes.data(), samples.size() * sizeof(roundtrip::Sample));
  return samples;
}

std::vector<roundtrip::Server::Answer> answers_of(std::span<const std::uint8_t> bytes) {
  std::vector<roundtrip::Server::Answer> answers(bytes.size() / sizeof(roundtrip::Server::Answer));
  if (!answers.empty())
    std::memcpy(answers.data(), bytes.data(), answers.size() * sizeof(roundtrip::Server::Answer));
  return answers;
}

}  // namespace ontime::agent

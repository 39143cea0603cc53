// SPDX-License-Identifier: Apache-2.0
// Orders and events, to and from JSON.
#include <bit>
#include <cstring>
#include <utility>

#include "agent/agent.hpp"
#include "record/outcome.hpp"

namespace ontime::agent {
namespace {

using nlohmann::json;
using transport::Role;

// Its parts, by name: they are many and all alike.
constexpr std::pair<const char*, std::string transport::Security::*> security_parts[] = {
    {"level", &transport::Security::level},
    {"identity_ca", &transport::Security::identity_ca},
    {"identity_certificate", &transport::Security::identity_certificate},
    {"private_key", &transport::Security::private_key},
    {"permissions_ca", &transport::Security::permissions_ca},
    {"governance", &transport::Security::governance},
    {"permissions", &transport::Security::permissions}};

json json_of(const std::optional<transport::Security>& security) {
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

template <typename Object>
std::vector<Object> copied(std::span<const std::uint8_t> bytes) {
  std::vector<Object> objects(bytes.size() / sizeof(Object));
  if (!objects.empty()) std::memcpy(objects.data(), bytes.data(), objects.size() * sizeof(Object));
  return objects;
}

}  // namespace

json to_json(const Task& task) {
  conditions::Run run;
  run.task = task;
  auto to = conditions::to_json(run);
  const auto& config = task.config;
  to["end"] = {{"is_client", config.role == Role::client},
               {"max_payload_bytes", config.max_payload_bytes},
               {"peers", config.peers},
               {"address", config.address},
               {"priority", config.priority ? json(*config.priority) : json()},
               {"security", json_of(config.security)},
               {"session", task.background.session}};
  return to;
}

Task task_of(const json& from) {
  auto task = conditions::run_of(from).task;
  auto& config = task.config;
  const auto& end = from.at("end");
  config.role = end.at("is_client").get<bool>() ? Role::client : Role::server;
  config.max_payload_bytes = end.at("max_payload_bytes");
  config.peers = end.at("peers").get<std::vector<std::string>>();
  config.address = end.value("address", "");  // no coordinator sent it until 0.2.0
  if (const auto& priority = end.at("priority"); !priority.is_null()) config.priority = priority;
  config.security = security_of(end.at("security"));
  task.background.session = end.at("session");
  return task;
}

json to_json(const roundtrip::Counters& counters) {
  record::Outcome outcome;
  outcome.has_counters = true;
  outcome.counters = counters;
  return record::to_json(outcome);
}

roundtrip::Counters counters_of(const json& from) { return record::Outcome(from).counters; }

std::string sample_layout() {
  return std::to_string(sizeof(roundtrip::Sample)) +
         (std::endian::native == std::endian::little ? "le" : "be");
}

std::vector<roundtrip::Sample> samples_of(std::span<const std::uint8_t> bytes) {
  return copied<roundtrip::Sample>(bytes);
}

std::vector<roundtrip::Server::Answer> answers_of(std::span<const std::uint8_t> bytes) {
  return copied<roundtrip::Server::Answer>(bytes);
}

}  // namespace ontime::agent

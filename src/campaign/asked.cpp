// SPDX-License-Identifier: Apache-2.0
// The record's form of a run: all that was asked for.
#include <chrono>

#include <fmt/format.h>

#include "campaign/campaign.hpp"
#include "keeper/keeper.hpp"
#include "record/record.hpp"

namespace ontime::campaign {
namespace {

using nlohmann::json;

double microseconds(std::chrono::nanoseconds time) { return static_cast<double>(time.count()) / 1e3; }

json or_null(const std::string& name) { return name.empty() ? json() : json(name); }

json asked_of_link(const Run& run) {
  if (!run.faults.any()) return nullptr;
  auto link = keeper::to_json(run.faults);
  link["cut"] =
      run.cut ? json{{"at_s", microseconds(run.cut->at) / 1e6}, {"for_ms", run.cut->length.count()}} : json();
  return link;
}

json asked(const Traffic& traffic) {
  if (traffic.bits_per_s == 0) return nullptr;
  return {{"bit_s", traffic.bits_per_s},
          {"datagram_bytes", traffic.datagram_bytes},
          {"direction", word_of(traffic.direction)},
          {"priority", traffic.priority}};
}

json asked(const Run::Step& step) {
  if (step.of == 0) return nullptr;
  return {{"key", step.key},
          {"value", step.value},
          {"step", step.number},
          {"steps", step.of},
          {"among", step.among}};
}

json asked(const roundtrip::NeighbourOptions& options) {
  if (options.topics == 0) return nullptr;
  return {
      {"topics", options.topics},
      {"where", roundtrip::word_of(options.where)},
      {"payload_bytes", options.payload_bytes},
      {"rate_hz", 1e9 / static_cast<double>(options.period.count())},
      {"reliability", options.reliability == transport::Reliability::reliable ? "reliable" : "best-effort"},
      {"there", options.there},
      {"back", options.back},
      {"priority", options.priority},
      {"callback_us", microseconds(options.callback)}};
}

json differences(const json& one, const json& other) {
  auto different = json::object();
  for (const auto& [key, value] : other.items())
    if (one.value(key, json()) != value) different[key] = value;
  for (const auto& [key, value] : one.items())
    if (!other.contains(key)) different[key] = "none";
  different.erase("beside");  // words for what is here
  return different;
}

}  // namespace

json asked(const machine::Wire& wire) {
  return wire.any() ? json{{"bits_per_s", wire.bits_per_s}, {"vlan", wire.vlan}} : json();
}

bool is_named(const Run& run) { return run.component != "component"; }

Together together(const Run& run, const Hosts& hosts) {
  Together runs;
  for (const auto& component : hosts.components) runs.push_back(with_component(run, component.name));
  return runs;
}

json asked(const Run& run, const Hosts& hosts) {
  const auto& client = run.task.client;
  const auto& interface = run.task.config.interface;
  const std::chrono::nanoseconds launch(run.task.config.launch_ns);
  return {
      {"id", run.id},
      {"title", run.title},
      {"variant", run.variant},
      {"beside", or_null(run.beside)},
      {"adds_to", run.adds_to},
      {"search", asked(run.step)},
      {"repetition", run.repetition},
      {"require", run.require.empty() ? json() : json(run.require)},
      {"transport", run.task.transport},
      {"options", run.task.config.options},
      {"component_transport", run.component_transport.empty() ? run.task.transport : run.component_transport},
      {"component_options",
       run.component_transport.empty() ? run.task.config.options : run.component_options},
      {"component_restart", run.component_restart ? json(true) : json()},
      {"component", is_named(run) ? json(run.component) : json()},
      {"security", run.security == security::Level::off ? json() : json(security::word_of(run.security))},
      {"domain", run.task.config.domain},
      {"ping_topic", run.task.config.ping_topic},
      {"pong_topic", run.task.config.pong_topic},
      {"interface", or_null(interface.empty() ? hosts.controller.interface : interface)},
      {"component_interface", or_null(hosts.at(run.component).interface)},
      {"payload_bytes", client.payload_bytes},
      {"period_us", microseconds(client.period)},
      {"deadline_us", microseconds(client.deadline)},
      {"timeout_us", microseconds(client.timeout)},
      {"duration_s", microseconds(client.duration) / 1e6},
      {"schedule", roundtrip::word_of(client.schedule)},
      {"launch_us", launch.count() > 0 ? json(microseconds(launch)) : json()},
      {"receive", agent::word_of(run.task.config.receive)},
      {"warm_up", client.warm_up},
      {"explain", run.explain ? json(true) : json()},
      {"count_instructions", run.task.count_instructions ? json(true) : json()},
      {"realtime", run.task.realtime.on},
      {"realtime_settings", run.task.realtime},
      {"qos", agent::to_json(run.task.config.qos)},
      {"load",
       {{"controller", keeper::to_json(run.controller_load)},
        {"component", keeper::to_json(run.component_load)}}},
      {"traffic", asked(run.traffic)},
      {"neighbours", asked(run.task.neighbours)},
      {"link", asked_of_link(run)},
      {"wire", asked(hosts.wire)},
      {"isolation", run.isolation.any() ? keeper::to_json(run.isolation) : json()},
      {"kernel", run.kernel.empty() ? json() : json(run.kernel)},
      {"ontime", ONTIME_VERSION}};
}

std::vector<json> asked(const Together& runs, const Hosts& hosts) {
  std::vector<json> all, conditions;
  for (const auto& run : runs)
    conditions.push_back(record::conditions_of(all.emplace_back(asked(run, hosts))));
  for (std::size_t i = 0; i < runs.size(); ++i)
    for (std::size_t other = 0; other < runs.size(); ++other)
      if (i != other) all[i]["others"][runs[other].component] = differences(conditions[i], conditions[other]);
  return all;
}

}  // namespace ontime::campaign

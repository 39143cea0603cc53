// SPDX-License-Identifier: Apache-2.0
// The record's form of a run on its hosts.
#include <algorithm>
#include <stdexcept>

#include "conditions/conditions.hpp"

namespace ontime::conditions {
namespace {

using nlohmann::json;

template <typename Any>
auto& find(Any& hosts, const std::string& name) {
  if (name == "controller") return hosts.controller;
  const auto is_it = [&](const auto& component) { return component.name == name; };
  const auto found = std::find_if(hosts.components.begin(), hosts.components.end(), is_it);
  if (found == hosts.components.end()) throw std::out_of_range("unknown host " + name);
  return found->host;
}

}  // namespace

const Host& Hosts::at(const std::string& name) const { return find(*this, name); }
Host& Hosts::at(const std::string& name) { return find(*this, name); }

const char* word_of(Hosts::Kind kind) {
  static constexpr const char* words[] = {"namespaces", "loopback", "stated", ""};
  return words[static_cast<std::size_t>(kind)];
}

bool is_named(const Run& run) { return run.component != "component"; }

json asked(const Wire& wire) {
  return wire.any() ? json{{"bits_per_s", wire.bits_per_s}, {"vlan", wire.vlan}} : json();
}

json asked(const Run& run, const Hosts& hosts) {
  auto all = to_json(run);
  if (all["interface"].is_null() && !hosts.controller.interface.empty())
    all["interface"] = hosts.controller.interface;
  const auto& interface = hosts.at(run.component).interface;
  all["component_interface"] = interface.empty() ? json() : json(interface);
  all["wire"] = asked(hosts.wire);
  all["ontime"] = ONTIME_VERSION;
  return all;
}

}  // namespace ontime::conditions

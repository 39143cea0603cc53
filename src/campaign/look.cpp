// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include <fmt/format.h>

#include "campaign/campaign.hpp"
#include "campaign/machines.hpp"
#include "settings/settings.hpp"

namespace ontime::campaign {

struct Look::Parts {
  Parts(const Scenario& scenario, Observer& observer, Interrupts& interrupts)
      : run(scenario.runs.front()),
        stated(scenario.hosts),
        coordinator(interrupts),
        machines(coordinator, observer) {
    machines.prepare(scenario.hosts);
  }
  std::string why_no_latency() const {
    for (const auto& [host, looked] : machines.look({}))
      if (const std::string why = looked.at("cpu_latency"); !why.empty()) return of(host, why);
    return "";
  }
  std::string why_not_of_kernel(const std::string& name, const settings::Wishes& wishes) const {
    const auto& hosts = machines.hosts();
    const auto table = settings::table();
    const auto row = std::ranges::find(table, name, &settings::Setting::name);
    if (row != table.end() && row->of_interface && hosts.kind == Hosts::Kind::loopback)
      return "messages stay on loopback, which is not a network card";
    if (is_virtual() && name == "gro" && wishes.contains("threaded-napi"))
      return "threaded-napi on the namespaces' interfaces needs gro: on";
    const auto looked = machines.look(wishes);
    if (looked.size() < hosts.components.size() + 1)
      return "a host's command prefix is not [ip, netns, exec, NAME]: ontime cannot look there";
    for (const auto& [host, found] : looked) {
      if (!found.at("is_root")) return of(host, "needs root. Fix: run as root");
      for (const auto* reason : {"cannot", "without_effect"})
        if (const std::string why = found.at(reason); why.starts_with(name + ": "))
          return of(host, why.substr(name.size() + 2));
    }
    return "";
  }
  // ontime creates the interfaces for the run, and removes them with it.
  bool is_virtual() const {
    return machines.hosts().kind == Hosts::Kind::namespaces && stated.controller.interface.empty();
  }
  std::string of(const std::string& host, const std::string& why) const {
    return machines.hosts().kind == Hosts::Kind::stated ? fmt::format("on the {}, {}", host, why) : why;
  }

  const Run run;
  const Hosts stated;
  orders::Coordinator coordinator;
  Machines machines;
};

Look::Look(const Scenario& scenario, Observer& observer, Interrupts& interrupts)
    : parts_(std::make_unique<Parts>(scenario, observer, interrupts)) {}
Look::~Look() = default;

std::string Look::why_not(const std::string& key, const std::string& value) const {
  constexpr std::string_view of_kernel = "kernel.";
  if (key == "realtime.cpu-latency") return parts_->why_no_latency();
  if (!key.starts_with(of_kernel)) return "";
  auto run = parts_->run;
  if (const auto* const known = key_named(key)) known->set(run, value);
  return parts_->why_not_of_kernel(key.substr(of_kernel.size()), run.kernel);
}

record::ByName<record::Machine> Look::machines() const {
  const auto& machines = parts_->machines;
  return {{"controller", machines.machine("controller")},
          {"component", machines.machine(parts_->run.component)}};
}

int Look::most_cpus() const {
  const auto& machines = parts_->machines;
  const auto cpus = [&](const std::string& host) { return machines.machine(host).cpu_count.value_or(1); };
  auto most = cpus(controller);
  for (const auto& component : machines.hosts().components) most = std::max(most, cpus(component.name));
  return static_cast<int>(most);
}

std::map<std::string, Look::Place> Look::places() const {
  std::map<std::string, Place> places;
  const auto& machines = parts_->machines;
  const auto& hosts = machines.hosts();
  const auto add = [&](const std::string& host) {
    places[host] = {{}, machines.program(host), machines.by_ssh(host)};
  };
  add(controller);
  for (const auto& component : hosts.components) add(component.name);
  if (hosts.kind == Hosts::Kind::loopback || parts_->is_virtual()) return places;
  const bool is_stated = hosts.kind == Hosts::Kind::stated;  // else ontime created the namespace
  for (const auto& [host, looked] : machines.look({}))
    places[host].link = {looked.at("interface"), is_stated ? looked.at("network_namespace") : ""};
  return places;
}

}  // namespace ontime::campaign

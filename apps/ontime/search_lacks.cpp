// SPDX-License-Identifier: Apache-2.0
#include "search_lacks.hpp"

#include <algorithm>
#include <array>
#include <optional>
#include <vector>

#include <fmt/format.h>
#include <unistd.h>

#include "machine/machine.hpp"
#include "realtime/realtime.hpp"
#include "settings/settings.hpp"

namespace ontime::app {
namespace {

using campaign::Host, campaign::Hosts;

constexpr std::array of_hardware = {"irq-cpus", "irq-threads", "coalescing"};
constexpr std::string_view kernel = "kernel.";

bool is_here(const Host& host) { return host.ssh.empty() && host.reach.empty(); }

// By the name that `ip netns` has for it; nothing: a place that a keeper cannot look into.
std::optional<std::string> namespace_of(const Host& host) {
  if (host.place.empty()) return "";
  const std::vector<std::string> exec = {"ip", "netns", "exec"};
  if (host.place.size() != 4 || !std::equal(exec.begin(), exec.end(), host.place.begin())) return {};
  return host.place.back();
}

// As the keeper of the host finds it.
settings::Link link_of(const Host& host, const std::string& peer) {
  settings::Link link{host.interface, namespace_of(host).value_or("")};
  if (!link.interface.empty()) return link;
  try {
    link.interface = peer.empty() ? machine::interface_of(host.address, link.network_namespace)
                                  : machine::interface_to(peer, link.network_namespace);
  } catch (const machine::Error&) {  // then it is not known
  }
  return link;
}

class Lacks {
 public:
  explicit Lacks(const campaign::Scenario& scenario) : run_(scenario.runs.front()) {
    const auto& hosts = scenario.hosts;
    const auto& component = hosts.components.front().host;
    const bool has_cable = !hosts.controller.interface.empty();
    is_loopback_ = hosts.kind == Hosts::Kind::loopback ||
                   (hosts.kind == Hosts::Kind::namespaces && !has_cable && !machine::may_join_namespaces());
    is_virtual_ = hosts.kind == Hosts::Kind::namespaces && !has_cable && !is_loopback_;
    if (is_loopback_ || is_virtual_) {
      links_ = {{}};
    } else if (hosts.kind == Hosts::Kind::namespaces) {
      links_ = {{hosts.controller.interface, ""}, {component.interface, ""}};
    } else {
      if (is_here(hosts.controller)) add(hosts.controller, scenario::without_port(component.address));
      if (is_here(component)) add(component, "");
    }
  }

  std::string operator()(const search::Setting& setting) const {
    if (links_.empty()) return "";
    if (setting.key == "realtime.cpu-latency") return why_no_latency();
    return setting.key.starts_with(kernel) ? why_not_of_kernel(setting) : "";
  }

 private:
  void add(const Host& host, const std::string& peer) {
    links_.push_back(link_of(host, peer));
    is_in_sight_ = is_in_sight_ && namespace_of(host).has_value();
  }

  std::string why_no_latency() const {
    if (!is_in_sight_) return "";
    const realtime::CpuLatencyRequest request(std::chrono::microseconds(0));
    return request.refusal() ? request.refusal()->found : "";
  }

  std::string why_not_of_kernel(const search::Setting& setting) const {
    if (geteuid() != 0) return "root alone can set it: run as root";
    if (!is_in_sight_) return "the place of a host is not [ip, netns, exec, NAME], where a keeper can look";
    const auto name = setting.key.substr(kernel.size());
    const auto table = settings::table();
    const auto row =
        std::find_if(table.begin(), table.end(), [&](const auto& one) { return one.name == name; });
    if (row != table.end() && row->of_interface && is_loopback_)
      return "messages stay on loopback, which is no network card";
    if (is_virtual_ && std::find(of_hardware.begin(), of_hardware.end(), name) != of_hardware.end())
      return "the namespaces' interfaces are virtual and have no interrupts";
    if (is_virtual_ && name == "gro" && run_.kernel.contains("threaded-napi"))
      return "threaded-napi needs gro on with the namespaces' interfaces";
    if (row != table.end() && row->of_interface && is_virtual_)
      return "";  // the interface is made by the run
    for (const auto& link : links_)
      if (auto why = why_not_planned(setting, name, link); !why.empty()) return why;
    return "";
  }

  std::string why_not_planned(const search::Setting& setting, const std::string& name,
                              const settings::Link& link) const {
    auto run = run_;
    for (const auto& key : campaign::keys())
      if (key.path == setting.key) key.set(run, setting.value);
    try {
      settings::plan(run.kernel, link);
    } catch (const settings::Error& error) {  // which begins with the name of a setting
      const std::string text = error.what();
      if (text.starts_with(name + ": ")) return text.substr(name.size() + 2);
    }
    return "";
  }

  campaign::Run run_;
  std::vector<settings::Link> links_;  // of the hosts on this machine
  bool is_loopback_ = false, is_virtual_ = false, is_in_sight_ = true;
};

}  // namespace

std::function<std::string(const search::Setting&)> lacks_of(const campaign::Scenario& scenario) {
  return Lacks(scenario);
}

}  // namespace ontime::app

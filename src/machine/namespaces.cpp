// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <chrono>
#include <filesystem>
#include <span>
#include <string_view>
#include <thread>

#include <fmt/format.h>
#include <linux/capability.h>
#include <unistd.h>

#include "journal/journal.hpp"
#include "machine/command.hpp"
#include "machine/machine.hpp"
#include "machine/proc.hpp"
#include "realtime/realtime.hpp"

namespace ontime::machine {
namespace {

using namespace std::chrono_literals;

constexpr auto time_for_link = 10s;
constexpr const char* frames_before_a_wire = "64";  // a socket's buffer holds more: the rest is lost

NamespaceEnd end(const std::string& host, const std::string& other, std::size_t number) {
  auto own = journal::own_prefix + host;
  std::replace(own.begin(), own.end(), '_', '-');
  return {host, own, "to-" + other, fmt::format("198.18.0.{}", number), {"ip", "netns", "exec", own}};
}

std::string leg_to(const std::string& component) { return "to-" + component; }

void inside(const NamespaceEnd& end, std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), {"ip", "-netns", end.name});
  iproute2(arguments);
}

void raise(const NamespaceEnd& end) {
  for (const auto& interface : {std::string("lo"), end.interface})
    inside(end, {"link", "set", interface, "up"});
}

// Each frame takes its time, and the next one waits for it, as before a wire.
void slow_down(const NamespaceEnd& end, std::uint64_t bits_per_s) {
  try {
    iproute2({"tc", "-netns", end.name, "qdisc", "add", "dev", end.interface, "root", "netem", "limit",
              frames_before_a_wire, "rate", fmt::format("{}bit", bits_per_s)});
  } catch (const Error& error) {
    const std::string_view said = error.what();
    const bool unknown =
        said.find("qdisc kind is unknown") != said.npos || said.find("Unknown qdisc") != said.npos;
    throw Error(fmt::format(
        "wire.rate: {}{}",
        unknown ? "this kernel has not what that needs (the queueing discipline netem, module sch_netem): "
                : "",
        said));
  }
}

void lay_vlan(NamespaceEnd& end, int vlan) {
  const auto name = fmt::format("vlan{}", vlan);
  std::vector<std::string> words = {
      "link", "add",  "link", end.interface,        "name",          name, "numtxqueues", "8",
      "type", "vlan", "id",   std::to_string(vlan), "egress-qos-map"};
  for (int priority = 0; priority < 8; ++priority) words.push_back(fmt::format("{0}:{0}", priority));
  try {
    inside(end, words);
  } catch (const Error& error) {
    throw Error(fmt::format("wire.vlan: {}", error.what()));
  }
  end.interface = name;
  inside(end, {"link", "set", name, "up"});
}

void configure(const NamespaceEnd& end) {
  inside(end, {"address", "add", end.address + "/24", "dev", end.interface});
  // For programs that join a multicast group, as DDS discovery does, and name no interface.
  inside(end, {"route", "add", "224.0.0.0/4", "dev", end.interface});
}

std::optional<Interface> interface(const std::string& name) {
  const auto all = interfaces();
  const auto found = std::ranges::find(all, name, &Interface::name);
  return found == all.end() ? std::nullopt : std::make_optional(*found);
}

template <class Done>
void wait_until(Done done, const std::string& why_not) {
  for (const auto limit = std::chrono::steady_clock::now() + time_for_link; !done();
       std::this_thread::sleep_for(2ms))
    if (std::chrono::steady_clock::now() > limit) throw Error(why_not);
}

void check_end_of_cable(const std::string& name) {
  std::optional<Interface> found;
  // A removed namespace returns its interfaces only some time after its name is gone.
  wait_until([&] { return (found = interface(name)).has_value(); },
             fmt::format("cable at {}: no such interface (see ip link)", name));
  if (!std::filesystem::exists("/sys/class/net/" + name + "/device"))
    throw Error(fmt::format("cable at {}: not hardware; the interface would be lost after the run", name));
  // The kernel takes an interface that goes to another namespace out of its bond or bridge, and does not put
  // it back.
  if (const auto master = master_of(name); !master.empty())
    throw Error(fmt::format(
        "cable at {0}: the interface belongs to {1}, and would not after the run. Fix: sudo ip link set {0} "
        "nomaster",
        name, master));
  if (found->up || !found->addresses.empty())
    throw Error(
        fmt::format("cable at {}: the interface is up or has an address, so a program may use it. Fix: sudo "
                    "ip link set {} "
                    "down; sudo ip address flush dev {}",
                    name, name, name));
}

void lay(const Cable& cable, NamespaceEnd& controller, NamespaceEnd& component) {
  controller.interface = cable.controller;
  component.interface = cable.component;
  for (const auto* end : {&controller, &component})
    iproute2({"ip", "link", "set", end->interface, "netns", end->name});
}

void join(const NamespaceEnd& controller, std::span<const NamespaceEnd> components) {
  const bool several = components.size() > 1;
  if (several)  // without snooping it floods multicast, as a plain switch does: discovery must not be lost
    inside(controller, {"link", "add", controller.interface, "type", "bridge", "mcast_snooping", "0"});
  for (const auto& component : components) {
    const auto leg = leg_to(component.host);
    iproute2({"ip", "link", "add", leg, "netns", controller.name, "type", "veth", "peer", "name",
              component.interface, "netns", component.name});
    if (several) inside(controller, {"link", "set", leg, "master", controller.interface, "up"});
  }
}

void wait_until_up(const NamespaceEnd& end) {
  const auto is_up = [&] {
    const auto said = iproute2({"ip", "-netns", end.name, "-oneline", "link", "show", end.interface});
    return said.find(" state UP ") != said.npos;
  };
  wait_until(is_up, fmt::format("the link between the namespaces does not come up (see ip -netns {} link)",
                                end.name));
}

}  // namespace

bool may_join_namespaces() {
  const auto status = text_of("/proc/thread-self/status").value_or("");
  // `ip` is another program: capabilities that only this file has do not reach it.
  return geteuid() == 0 && realtime::has_capability(status, CAP_SYS_ADMIN) &&
         realtime::has_capability(status, CAP_NET_ADMIN);
}

std::vector<NamespaceEnd> join_namespaces(journal::Journal& journal,
                                          const std::vector<std::string>& components,
                                          const std::optional<Cable>& cable, const Wire& wire) {
  if (!may_join_namespaces())
    throw Error(
        "hosts: namespaces needs root. Fix: run as root (in a container: with the capabilities SYS_ADMIN and "
        "NET_ADMIN), or run both ends on loopback");
  if (cable)
    for (const auto& name : {cable->controller, cable->component}) check_end_of_cable(name);
  const bool several = components.size() > 1;
  std::vector<NamespaceEnd> ends{end("controller", several ? "components" : components.at(0), 1)};
  for (const auto& component : components) {
    ends.push_back(end(component, "controller", ends.size() + 1));
    if (several) ends.back().port = leg_to(component);
  }
  for (const auto& end : ends) journal::add_namespace(journal, end.name);
  if (cable)
    lay(*cable, ends.at(0), ends.at(1));
  else
    join(ends.front(), std::span(ends).subspan(1));
  for (const auto& end : ends) raise(end);
  for (const auto& end : ends) wait_until_up(end);
  for (auto& end : ends) {
    if (wire.bits_per_s > 0) slow_down(end, wire.bits_per_s);
    if (wire.vlan > 0) lay_vlan(end, wire.vlan);
    configure(end);
  }
  return ends;
}

}  // namespace ontime::machine

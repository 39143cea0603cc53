// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <chrono>
#include <iterator>
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

NamespaceEnd end(const std::string& host, const std::string& other, std::size_t number) {
  auto own = journal::own_prefix + host;
  std::replace(own.begin(), own.end(), '_', '-');
  return {host, own, "to-" + other, fmt::format("198.18.0.{}", number), {"ip", "netns", "exec", own}};
}

void configure(const NamespaceEnd& end) {
  const auto inside = [&](std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), {"-netns", end.name});
    ip(arguments);
  };
  inside({"address", "add", end.address + "/24", "dev", end.interface});
  inside({"link", "set", "lo", "up"});
  inside({"link", "set", end.interface, "up"});
  // For programs that join a multicast group, as DDS discovery does, and name no interface.
  inside({"route", "add", "224.0.0.0/4", "dev", end.interface});
}

void wait_until_up(const NamespaceEnd& end) {
  const auto limit = std::chrono::steady_clock::now() + time_for_link;
  while (ip({"-netns", end.name, "-oneline", "link", "show", end.interface}).find(" state UP ") ==
         std::string::npos) {
    if (std::chrono::steady_clock::now() > limit)
      throw Error(
          fmt::format("the link between the namespaces does not come up: see ip -netns {} link", end.name));
    std::this_thread::sleep_for(2ms);
  }
}

}  // namespace

bool may_join_namespaces() {
  const auto status = text_of("/proc/thread-self/status").value_or("");
  // `ip` is another program: capabilities that only this file has do not reach it.
  return geteuid() == 0 && realtime::has_capability(status, CAP_SYS_ADMIN) &&
         realtime::has_capability(status, CAP_NET_ADMIN);
}

std::vector<NamespaceEnd> join_namespaces(journal::Journal& journal,
                                          const std::vector<std::string>& components) {
  if (!may_join_namespaces())
    throw Error(
        "network namespaces were asked for, which this process may not make: run as root (in a container, "
        "with the capabilities SYS_ADMIN and NET_ADMIN), or run both ends on loopback");
  const bool several = components.size() > 1;
  std::vector<NamespaceEnd> ends{end("controller", several ? "components" : components.at(0), 1)};
  for (const auto& component : components) ends.push_back(end(component, "controller", ends.size() + 1));
  for (const auto& end : ends) journal::add_namespace(journal, end.name);
  const auto& controller = ends.front();
  if (several)  // that floods groups as a plain switch does: who knows of none must not lose discovery
    ip({"-netns", controller.name, "link", "add", controller.interface, "type", "bridge", "mcast_snooping",
        "0"});
  for (auto component = std::next(ends.begin()); component != ends.end(); ++component) {
    const auto leg = "to-" + component->host;
    ip({"link", "add", leg, "netns", controller.name, "type", "veth", "peer", "name", component->interface,
        "netns", component->name});
    if (several) ip({"-netns", controller.name, "link", "set", leg, "master", controller.interface, "up"});
  }
  for (const auto& end : ends) configure(end);
  for (const auto& end : ends) wait_until_up(end);
  return ends;
}

}  // namespace ontime::machine

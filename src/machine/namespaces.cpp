// SPDX-License-Identifier: Apache-2.0
#include <chrono>
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

NamespacePair::End end(const std::string& name, const std::string& other, const std::string& address) {
  const auto own = journal::own_prefix + name;
  return {own, "to-" + other, address, {"ip", "netns", "exec", own}};
}

void configure(const NamespacePair::End& end) {
  const auto inside = [&](std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), {"-netns", end.name});
    ip(arguments);
  };
  inside({"address", "add", end.address + "/30", "dev", end.interface});
  inside({"link", "set", "lo", "up"});
  inside({"link", "set", end.interface, "up"});
  // For programs that join a multicast group, as DDS discovery does, and name no interface.
  inside({"route", "add", "224.0.0.0/4", "dev", end.interface});
}

void wait_until_up(const NamespacePair::End& end) {
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

NamespacePair join_namespaces(journal::Journal& journal) {
  if (!may_join_namespaces())
    throw Error(
        "two network namespaces were asked for, which this process may not make: run as root (in a "
        "container, with the capabilities SYS_ADMIN and NET_ADMIN), or run both ends on loopback");
  NamespacePair pair{end("controller", "component", "198.18.0.1"),
                     end("component", "controller", "198.18.0.2")};
  journal::add_namespace(journal, pair.controller.name);
  journal::add_namespace(journal, pair.component.name);
  ip({"link", "add", pair.controller.interface, "netns", pair.controller.name, "type", "veth", "peer", "name",
      pair.component.interface, "netns", pair.component.name});
  configure(pair.controller);
  configure(pair.component);
  wait_until_up(pair.controller);
  wait_until_up(pair.component);
  return pair;
}

}  // namespace ontime::machine

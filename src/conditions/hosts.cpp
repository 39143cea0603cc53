// SPDX-License-Identifier: Apache-2.0
// Hosts: their keys, those of the wire, and the record's form of a run on them.
#include <algorithm>

#include <arpa/inet.h>

#include "conditions/fields.hpp"
#include "journal/journal.hpp"

namespace ontime::conditions {
namespace {

using nlohmann::json;
using Words = std::vector<std::string>;

template <typename Any>
auto& find(Any& hosts, Text name) {
  if (name == "controller") return hosts.controller;
  const auto found = std::ranges::find(hosts.components, name, &Hosts::Component::name);
  if (found == hosts.components.end()) throw std::out_of_range("unknown host " + name);
  return found->host;
}

void check_destination(Text text) {
  const auto odd = [](unsigned char c) { return c <= ' ' || c == 0x7f; };
  if (text[0] == '-' || std::ranges::any_of(text, odd))
    throw std::invalid_argument(fmt::format(
        "'{}' is not an ssh destination, such as robot, user@host or ssh://user@host:port", text));
}

void check_interface(Text text) {
  if (!journal::is_interface_name(text))
    throw std::invalid_argument(
        fmt::format("'{}' is not an interface name of at most 15 letters, digits and _-.@ (a limit of tc and "
                    "nft); see \"ip link\"",
                    text));
}

PartKey<Host> word(
    const char* path, const char* values, const char* help, std::string Host::*member,
    void (*check)(Text) = [](Text) {}) {
  return {path, values, help, [=](Host& host, const Words& words) {
            check(words.front());
            host.*member = words.front();
          }};
}

// What becomes a command is a list, so that no shell splits it at blanks.
PartKey<Host> command(const char* path, const char* earlier, const char* help, Words Host::*member) {
  return {path, "[WORD, …]", help, [=](Host& host, const Words& words) { host.*member = words; },
          true, earlier};
}

}  // namespace

void check_address(Text text) {
  const bool in_brackets = text.starts_with('[');
  auto address = in_brackets ? text.substr(1, text.find(']') - 1) : text;
  address = address.substr(0, address.find('%'));
  in6_addr found{};
  if (inet_pton(AF_INET6, address.c_str(), &found) == 1)
    throw std::invalid_argument(fmt::format("'{}' is an IPv6 address; messages need an IPv4 address", text));
}

const Host& Hosts::at(const std::string& name) const { return find(*this, name); }
Host& Hosts::at(const std::string& name) { return find(*this, name); }

const char* word_of(Hosts::Kind kind) {
  static constexpr const char* words[] = {"namespaces", "loopback", "stated", ""};
  return words[static_cast<std::size_t>(kind)];
}

const std::vector<PartKey<Host>>& host_keys() {
  static const std::vector<PartKey<Host>> keys{
      word("ssh", "DESTINATION",
           "the machine, as in the `ssh` command: `robot`, `user@host`; without it: this machine", &Host::ssh,
           check_destination),
      command("host-prefix", "reach", "words put before every command there, such as `[sudo, -n]`",
              &Host::host_prefix),
      command("command-prefix", "place",
              "words before the command of client or server only, such as `[ip, netns, exec, robot]`",
              &Host::command_prefix),
      word(
          "program", "PATH",
          "ontime on that machine; without it: the path on this machine; by ssh, `ontime` as the shell there "
          "finds it",
          &Host::program),
      word("interface", "NAME", "the link under test; messages use no other", &Host::interface,
           check_interface),
      word("address", "ADDRESS", "for messages from the other host; the component's is required",
           &Host::address, check_address)};
  return keys;
}

const std::vector<PartKey<Wire>>& wire_keys() {
  static const std::vector<PartKey<Wire>> keys{
      {"rate", "RATE",
       "netem sends the frames of each host one after the other at this rate. At most 64 wait; more are "
       "dropped",
       [](Wire& wire, const Words& words) { wire.bits_per_s = bit_rate_of(words.front()); }},
      {"vlan", "1-4094",
       "the interface under test is that of this VLAN, such as `vlan5`, with eight queues. Priorities 0 to 7 "
       "become the class (PCP) that a switch sees",
       [](Wire& wire, const Words& words) {
         wire.vlan = static_cast<int>(number_of(words.front(), 1, 4094));
       }}};
  return keys;
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

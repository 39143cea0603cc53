// SPDX-License-Identifier: Apache-2.0
#include "scenario/hosts.hpp"

#include <algorithm>
#include <set>
#include <stdexcept>

#include <fmt/format.h>

#include "journal/journal.hpp"
#include "scenario/document.hpp"

namespace ontime::scenario {
namespace {

using conditions::bit_rate_of, conditions::Host, conditions::Key, conditions::keys, conditions::number_of;

constexpr std::size_t most_components = 32;
constexpr int most_vlan = 4094;
constexpr std::size_t longest_name = 12;  // "to-NAME" is an interface

class HostsOfFile {
 public:
  HostsOfFile(const std::string& file, Notices& notices) : file_(file), notices_(notices) {}

  void read(const YAML::Node& node, bool names_components) {
    if (node.IsScalar()) return read_kind(node);
    if (!node.IsMap()) fail(node, "hosts: use namespaces, loopback, or a map of controller and component");
    once_each(file_, node);
    hosts_.kind = Hosts::Kind::stated;
    auto& component = hosts_.components.front().host;
    for (const auto& entry : node) {
      const auto name = entry.first.Scalar();
      if (name == "controller")
        hosts_.controller = host_of(entry.second);
      else if (name == "component" && !names_components)
        component = host_of(entry.second);
      else if (name == "component")
        fail(entry.first, "hosts: component and components exclude each other: move component to components");
      else
        fail(entry.first,
             fmt::format("hosts: unknown host '{}'; allowed hosts: controller, component", name));
    }
    if (component.address.empty() && !names_components)
      fail(node, "hosts: component.address is missing: the controller sends to it");
  }

  // A list of names, or a map of name and host where hosts are stated.
  void read_components(const YAML::Node& node) {
    const bool stated = hosts_.kind == Hosts::Kind::stated;
    if (hosts_.kind == Hosts::Kind::loopback)
      fail(node, "components: loopback has one component; for several use hosts: namespaces");
    if (stated ? !node.IsMap() : !node.IsSequence())
      fail(node, stated ? "components: where hosts is a map, a map of names and hosts is needed: {arm: "
                          "{address: …}, base: {address: …}}"
                        : "components: a list of names is needed, such as [arm, base]; to set their "
                          "addresses, add hosts: {controller: …}");
    hosts_.components.clear();
    if (stated) once_each(file_, node);
    for (const auto& entry : node) {
      const auto& name = stated ? entry.first : entry;
      hosts_.components.push_back({name_of(name), stated ? host_of(entry.second) : Host{}});
      if (stated && hosts_.components.back().host.address.empty())
        fail(name,
             fmt::format("components: {}.address is missing: the controller sends to it", name.Scalar()));
    }
    if (hosts_.components.empty() || hosts_.components.size() > most_components)
      fail(node, fmt::format("components: {} names; 1 to {} are allowed", hosts_.components.size(),
                             most_components));
  }

  Hosts take() { return std::move(hosts_); }

 private:
  [[noreturn]] void fail(const YAML::Node& node, const std::string& message) const {
    fail_at(file_, node.Mark(), message);
  }

  void read_kind(const YAML::Node& node) {
    if (node.Scalar() != "namespaces" && node.Scalar() != "loopback")
      fail(node, fmt::format("hosts: '{}' is not namespaces, loopback, or a map of controller and component",
                             node.Scalar()));
    hosts_.kind = node.Scalar() == "loopback" ? Hosts::Kind::loopback : Hosts::Kind::namespaces;
  }

  // A component's name may hold keys of its own run, beside the keys that apply to all.
  static bool has_a_meaning(const std::string& name) {
    for (const auto* word : {"controller", "component", "components", "id", "require", "options"})
      if (name == word || name.starts_with("controller_")) return true;  // of what is made for it there
    const auto begins_so = [&](const Key& key) {
      return key.path == name || key.path.starts_with(name + ".");
    };
    return std::any_of(keys().begin(), keys().end(), begins_so);
  }

  // It becomes part of a topic, of an interface's name and of a network namespace's.
  std::string name_of(const YAML::Node& node) const {
    auto name = scalar_of(file_, node, "components");
    const auto plain = [](char c) { return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_'; };
    if (name.size() > longest_name || !std::all_of(name.begin(), name.end(), plain) || name[0] < 'a')
      fail(node, fmt::format("components: '{}' is not a name of at most {} lower-case letters, digits and _, "
                             "starting with a letter",
                             name, longest_name));
    if (has_a_meaning(name))
      fail(node, fmt::format("components: '{}' is already the name of a key; choose another", name));
    const auto same = [&](const auto& component) { return component.name == name; };
    if (std::any_of(hosts_.components.begin(), hosts_.components.end(), same))
      fail(node, fmt::format("components: '{}' occurs twice", name));
    return name;
  }

  Host host_of(const YAML::Node& node) {
    const std::string keys = "a host has ssh, host-prefix, command-prefix, program, interface, address";
    if (!node.IsMap()) fail(node, keys);
    once_each(file_, node);
    Host host;
    std::set<std::string> read;
    for (const auto& entry : node) {
      const auto stated = entry.first.Scalar();
      const auto key = conditions::current_key(stated);
      const auto& value = entry.second;
      if (key != stated) note_renamed(notices_, file_, entry.first.Mark(), stated, key);
      if (!read.insert(key).second) fail(entry.first, fmt::format("'{}' occurs twice", key));
      if (key == "ssh")
        host.ssh = read_destination(value);
      else if (key == "host-prefix")
        host.host_prefix = read_words(value, key);
      else if (key == "command-prefix")
        host.command_prefix = read_words(value, key);
      else if (key == "program")
        host.program = scalar_of(file_, value, key);
      else if (key == "interface")
        host.interface = read_interface(value);
      else if (key == "address")
        host.address = scalar_of(file_, value, key);
      else if (key == "prefix")
        fail(entry.first,
             "prefix no longer exists; state the machine, such as ssh: robot, and a command prefix, such as "
             "command-prefix: [ip, netns, exec, robot]");
      else
        fail(entry.first, fmt::format("unknown key '{}'; {}", key, keys));
    }
    return host;
  }

  std::string read_destination(const YAML::Node& node) const {
    auto destination = scalar_of(file_, node, "ssh");
    const auto odd = [](unsigned char c) { return c <= ' ' || c == 0x7f; };
    if (destination[0] == '-' || std::any_of(destination.begin(), destination.end(), odd))
      fail(node, fmt::format(
                     "ssh: '{}' is not an ssh destination, such as robot, user@host or ssh://user@host:port",
                     destination));
    return destination;
  }

  // What becomes a command is a list, so that no shell splits it at blanks.
  std::vector<std::string> read_words(const YAML::Node& node, const std::string& key) const {
    if (!node.IsSequence())
      fail(node, fmt::format("{}: a list of words is needed, such as {}; they run as a program", key,
                             key == "host-prefix" ? "[sudo, -n]" : "[ip, netns, exec, robot]"));
    std::vector<std::string> words;
    for (const auto& word : node) words.push_back(scalar_of(file_, word, key));
    return words;
  }

  std::string read_interface(const YAML::Node& node) const {
    auto name = scalar_of(file_, node, "interface");
    if (!journal::is_interface_name(name))
      fail(node, fmt::format("interface: '{}' is not an interface name of at most 15 letters, digits and "
                             "_-.@ (a limit of tc and nft); see \"ip link\"",
                             name));
    return name;
  }

  const std::string& file_;
  Notices& notices_;
  Hosts hosts_;
};

}  // namespace

Hosts hosts_of(const std::string& file, const std::optional<YAML::Node>& hosts,
               const std::optional<YAML::Node>& components, Notices& notices) {
  HostsOfFile found(file, notices);
  if (hosts) found.read(*hosts, components.has_value());
  if (components) found.read_components(*components);
  return found.take();
}

void lay_wire(const std::string& file, const YAML::Node& node, Hosts& hosts) {
  const auto fail = [&](const YAML::Node& at, const std::string& message) {
    fail_at(file, at.Mark(), "wire: " + message);
  };
  if (hosts.kind != Hosts::Kind::namespaces || hosts.components.size() > 1)
    fail(node, "it needs hosts: namespaces with one component");
  if (!node.IsMap() || node.size() == 0)
    fail(node, "it needs a rate, a vlan, or both: {rate: 10 Mbit/s, vlan: 5}");
  once_each(file, node);
  for (const auto& entry : node) {
    const auto key = entry.first.Scalar();
    const auto text = scalar_of(file, entry.second, key);
    try {
      if (key == "rate")
        hosts.wire.bits_per_s = bit_rate_of(text);
      else if (key == "vlan")
        hosts.wire.vlan = static_cast<int>(number_of(text, 1, most_vlan));
      else
        fail(entry.first, fmt::format("unknown key '{}'; allowed keys: rate, vlan", key));
    } catch (const std::invalid_argument& error) {
      fail(entry.second, fmt::format("{}: {}", key, error.what()));
    }
  }
}

void lay_cable(const std::string& file, const std::vector<std::string>& interfaces, Hosts& hosts) {
  if (hosts.kind != Hosts::Kind::namespaces || hosts.components.size() > 1)
    throw Error(
        fmt::format("--cable needs hosts: namespaces with one component, and {} has other hosts", file));
  if (interfaces.size() != 2 || interfaces[0] == interfaces[1])
    throw Error("--cable needs two interfaces, such as eth1,eth2");
  hosts.controller.interface = interfaces[0];
  hosts.components.front().host.interface = interfaces[1];
}

}  // namespace ontime::scenario

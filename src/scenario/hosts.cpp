// SPDX-License-Identifier: Apache-2.0
#include "scenario/hosts.hpp"

#include <algorithm>
#include <set>
#include <stdexcept>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "spelling/spelling.hpp"

namespace ontime::scenario {
namespace {

using conditions::Host, conditions::Key, conditions::keys, conditions::PartKey;

constexpr std::size_t most_components = 32;
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
        fail(entry.first, "hosts: unknown host '{}'{}; allowed hosts: controller, component", name,
             spelling::suggestion(name, {"controller", "component"}));
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
      fail(node, "{}",
           stated ? "components: where hosts is a map, a map of names and hosts is needed: {arm: "
                    "{address: …}, base: {address: …}}"
                  : "components: a list of names is needed, such as [arm, base]; to set their "
                    "addresses, add hosts: {controller: …}");
    hosts_.components.clear();
    if (stated) once_each(file_, node);
    for (const auto& entry : node) {
      const auto& name = stated ? entry.first : entry;
      hosts_.components.push_back({name_of(name), stated ? host_of(entry.second) : Host{}});
      if (stated && hosts_.components.back().host.address.empty())
        fail(name, "components: {}.address is missing: the controller sends to it", name.Scalar());
    }
    if (hosts_.components.empty() || hosts_.components.size() > most_components)
      fail(node, "components: {} names; 1 to {} are allowed", hosts_.components.size(), most_components);
  }

  void read_wire(const YAML::Node& node) {
    if (hosts_.kind != Hosts::Kind::namespaces || hosts_.components.size() > 1)
      fail(node, "wire: it needs hosts: namespaces with one component");
    if (!node.IsMap() || node.size() == 0)
      fail(node, "wire: it needs a rate, a vlan, or both: {{rate: 10 Mbit/s, vlan: 5}}");
    read_keys(node, "wire.", conditions::wire_keys(), hosts_.wire);
  }

  Hosts take() { return std::move(hosts_); }

 private:
  template <class... Values>
  [[noreturn]] void fail(const YAML::Node& node, fmt::format_string<Values...> text,
                         Values&&... values) const {
    fail_at(file_, node.Mark(), text, std::forward<Values>(values)...);
  }

  void read_kind(const YAML::Node& node) {
    if (node.Scalar() != "namespaces" && node.Scalar() != "loopback")
      fail(node, "hosts: '{}' is not namespaces, loopback, or a map of controller and component",
           node.Scalar());
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
      fail(node,
           "components: '{}' is not a name of at most {} lower-case letters, digits and _, "
           "starting with a letter",
           name, longest_name);
    if (has_a_meaning(name))
      fail(node, "components: '{}' is already the name of a key; choose another", name);
    const auto same = [&](const auto& component) { return component.name == name; };
    if (std::any_of(hosts_.components.begin(), hosts_.components.end(), same))
      fail(node, "components: '{}' occurs twice", name);
    return name;
  }

  Host host_of(const YAML::Node& node) {
    Host host;
    for (const auto& entry : node)
      if (node.IsMap() && entry.first.IsScalar() && entry.first.Scalar() == "prefix")
        fail(entry.first,
             "prefix no longer exists; state the machine, such as ssh: robot, and a command prefix, such as "
             "command-prefix: [ip, netns, exec, robot]");
    read_keys(node, "", conditions::host_keys(), host);
    return host;
  }

  // `above`: "wire.", before the names of its keys.
  template <typename Of>
  void read_keys(const YAML::Node& node, const std::string& above, const std::vector<PartKey<Of>>& keys,
                 Of& of) {
    std::vector<std::string> allowed;
    allowed.reserve(keys.size());
    for (const auto& key : keys) allowed.push_back(key.path);
    if (!node.IsMap()) fail(node, "keys and values are needed here: {}", fmt::join(allowed, ", "));
    once_each(file_, node);
    std::set<std::string> read;
    for (const auto& entry : node) {
      const auto &name = entry.first, &value = entry.second;
      const auto stated = name.Scalar();
      const auto is_it = [&](const auto& key) { return key.path == stated || key.earlier == stated; };
      const auto key = std::ranges::find_if(keys, is_it);
      if (key == keys.end()) fail(name, "unknown key '{}{}'{}", above, stated, meant_of(stated, allowed));
      if (key->path != stated) note_renamed(notices_, file_, name.Mark(), stated, key->path);
      const auto path = above + key->path;
      if (!read.insert(path).second) fail(name, "'{}' occurs twice", path);
      const auto words = words_of(value, path, key->is_list);
      try {
        key->set(of, words);
      } catch (const std::invalid_argument& error) {
        fail(value, "{}: {}", path, error.what());
      }
    }
  }

  std::vector<std::string> words_of(const YAML::Node& node, const std::string& key, bool is_list) const {
    if (!is_list) return {scalar_of(file_, node, key)};
    if (!node.IsSequence())
      fail(node, "{}: a list of words is needed, such as [sudo, -n]; they run as a program", key);
    std::vector<std::string> words;
    for (const auto& word : node) words.push_back(scalar_of(file_, word, key));
    return words;
  }

  const std::string& file_;
  Notices& notices_;
  Hosts hosts_;
};

}  // namespace

Hosts hosts_of(const std::string& file, const YAML::Node& hosts, const YAML::Node& components,
               const YAML::Node& wire, Notices& notices) {
  HostsOfFile found(file, notices);
  if (hosts) found.read(hosts, components.IsDefined());
  if (components) found.read_components(components);
  if (wire) found.read_wire(wire);
  return found.take();
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

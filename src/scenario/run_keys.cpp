// SPDX-License-Identifier: Apache-2.0
#include "scenario/run_keys.hpp"

#include <algorithm>
#include <set>
#include <string_view>

#include <fmt/format.h>

#include "scenario/document.hpp"
#include "spelling/spelling.hpp"

namespace ontime::scenario {
namespace {

using conditions::keys;

// "cpus" for "isolation"; "": no key is below it.
std::string key_below(const std::string& path) {
  for (const auto& key : keys())
    if (key.path.starts_with(path + "."))
      return key.path.substr(path.size() + 1, key.path.find('.', path.size() + 1) - path.size() - 1);
  return "";
}

// Why a key cannot be set for one of several components, for people; "": it can.
std::string common_to_all(const std::string& path) {
  constexpr std::pair<std::string_view, const char*> reasons[] = {
      {"id", "all components share the run"},
      {"title", "all components share the run"},
      {"baseline", "all components share the run"},
      {"search", "all components share the run: write search: NAME.KEY there"},
      {"duration", "all components are measured at the same time"},
      {"explain", "kernel events are recorded for all components or for none"},
      {"kernel.", "it changes machines, and all components share the controller"},
      {"isolation.", "it changes machines, and all components share the controller"},
      {"load.controller.", "all components share the controller"}};
  for (const auto& [key, reason] : reasons)
    if (path == key || (key.ends_with('.') && path.starts_with(key))) return reason;
  return "";
}

// As common_to_all(), also for link keys: behind a bridge each component has its own link to the controller.
std::string why_not_its_own(const std::string& key, const Hosts& hosts) {
  if (!key.starts_with("link.") || hosts.components.size() == 1) return common_to_all(key);
  if (hosts.kind == Hosts::Kind::stated) return "all components share the controller's interface";
  if (key == "link.message-priority" || key == "link.traffic-priority" || key == "link.dscp")
    return "the controller uses one value for all that it sends";
  return "";
}

// Whether a run has this key, with a value.
bool is_of_a_run(const std::string& key) {
  return is_key(key) || is_option(key) || key == "id" || key == "require";
}

}  // namespace

bool is_key(const std::string& path) {
  return std::ranges::find(keys(), path, &conditions::Key::path) != keys().end();
}

std::string meant_in_file(const std::string& key) {
  const auto now = conditions::current_key(key);
  if (is_of_a_run(now) || !key_below(now).empty() || now == "options")
    return fmt::format(": it is a key of runs. Write it {}in a run",
                       now == "id" ? "" : "below defaults, or ");
  return meant_of(key, file_keys);
}

std::string meant_of(const std::string& path) {
  if (std::ranges::find(file_keys, path) != file_keys.end())
    return ": it is a key of the file. Write it beside runs";
  const auto dot = path.rfind('.');
  const auto parent = dot == std::string::npos ? std::string() : path.substr(0, dot + 1);
  std::set<std::string> siblings;
  for (const auto& key : keys())
    if (key.path.starts_with(parent))
      siblings.insert(key.path.substr(parent.size(), key.path.find('.', parent.size()) - parent.size()));
  if (parent.empty()) siblings.insert({"id", "options", "require"});
  if (siblings.empty()) return meant_of(parent.substr(0, parent.size() - 1));
  return meant_of(path.substr(parent.size()), {siblings.begin(), siblings.end()});
}

Said RunKeys::divided(const std::string& path) const {
  const auto dot = path.find('.');
  auto name = path.substr(0, dot);
  const auto is_it = [&](const auto& component) { return component.name == name; };
  if (!named_ || std::ranges::none_of(hosts_.components, is_it)) return {"", path};
  return {std::move(name), dot == path.npos ? "" : path.substr(dot + 1)};
}

std::string RunKeys::current(const std::string& path) const {
  const auto key = divided(path).key;
  return path.substr(0, path.size() - key.size()) + conditions::current_key(key);
}

Entries RunKeys::flat(const YAML::Node& run) const {
  Entries entries;
  flatten(run, "", entries, nullptr);
  return entries;
}

std::string RunKeys::meant_of(const std::string& path, const std::string& key) const {
  std::vector<std::string> names;
  if (named_)
    for (const auto& component : hosts_.components) names.push_back(component.name);
  const auto name = path.substr(0, path.find('.'));
  const auto meant = key == path && name != path ? spelling::suggestion(name, names) : "";
  return meant.empty() ? scenario::meant_of(key) : meant;
}

// No key below it would show that it is mistyped.
void RunKeys::check_empty(const YAML::Node& name, const YAML::Node& map, const std::string& path) const {
  const auto key = divided(path).key;
  if (key.empty() || key == "options" || key == "component.options" || !key_below(key).empty()) return;
  if (is_of_a_run(key)) fail_at(file_, map.Mark(), "{}: a value is needed here", path);
  fail_at(file_, name.Mark(), "unknown key '{}'{}", path, meant_of(path, key));
}

void RunKeys::flatten(const YAML::Node& node, const std::string& prefix, Entries& entries,
                      const YAML::Node* unknown) const {
  if (!node.IsMap())
    fail_at(file_, node.Mark(), "{}",
            prefix.empty() ? "keys and values are needed here" : prefix + ": a value is needed here");
  once_each(file_, node);
  for (const auto& entry : node) {
    const auto stated = prefix + entry.first.Scalar();
    const auto path = current(stated);
    if (path != stated)
      note_renamed(notices_, file_, entry.first.Mark(), divided(stated).key, divided(path).key);
    if (entry.second.IsMap()) {
      if (divided(path).key == "require")
        fail_at(file_, entry.second.Mark(), "{}: a list of limits is needed, such as [p99 <= 5 ms]", path);
      if (entry.second.size() == 0) check_empty(entry.first, entry.second, path);
      const auto key = divided(path).key;
      flatten(entry.second, path + ".", entries,
              unknown != nullptr || key.empty() || !key_below(key).empty() ? unknown : &entry.first);
      continue;
    }
    const auto [component, key] = divided(path);
    if (!component.empty() && key.empty())
      fail_at(file_, entry.first.Mark(),
              "{0}: keys of this component are needed here, such as {0}: {{period: 2 ms}}", component);
    if (!is_of_a_run(key)) {
      if (const auto below = key_below(key); !below.empty())
        fail_at(file_, entry.second.Mark(), "{0}: keys and values are needed here, such as {0}: {{{1}: …}}",
                path, below);
      fail_at(file_, (unknown != nullptr ? *unknown : entry.first).Mark(), "unknown key '{}'{}", path,
              meant_of(path, key));
    }
    if (const auto reason = component.empty() ? "" : why_not_its_own(key, hosts_); !reason.empty())
      fail_at(file_, entry.first.Mark(), "{}: cannot be set for one component: {}", path, reason);
    if (!entries.emplace(path, entry.second).second)
      fail_at(file_, entry.first.Mark(), "'{}' occurs twice", path);
  }
}

}  // namespace ontime::scenario

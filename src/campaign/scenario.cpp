// SPDX-License-Identifier: Apache-2.0
// A scenario file: keys and their words are the table in keys.cpp; here are the file's shape and its errors.
#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>
#include <system_error>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <yaml-cpp/yaml.h>

#include "campaign/campaign.hpp"

namespace ontime::campaign {
namespace {

// A run as written, flat: path ("qos.depth") → what stands there.
using Entries = std::map<std::string, YAML::Node>;

class File {
 public:
  File(const std::string& path, const Selection& selection) : selection_(selection) {
    scenario_.file = path;
    std::error_code none;
    const bool folder = std::filesystem::is_directory(path, none);
    std::ifstream in(path);
    if (folder || !in)
      throw Error(2, fmt::format("scenario {} cannot be read: {}", path,
                                 std::generic_category().message(folder ? EISDIR : errno)));
    std::ostringstream text;
    text << in.rdbuf();
    scenario_.text = text.str();
  }

  Scenario read() {
    YAML::Node root;
    try {
      root = YAML::Load(scenario_.text);
    } catch (const YAML::Exception& error) {
      fail(error.mark, error.msg);
    }
    if (!root.IsMap())
      throw Error(2, scenario_.file + ": not a scenario: it has no keys (title, hosts, defaults, runs …)");
    Entries defaults;
    bool interleaved = true;
    std::int64_t repeat = 1;
    YAML::Node runs;
    once_each(root);
    for (const auto& entry : root) {
      const auto key = entry.first.Scalar();
      const auto& value = entry.second;
      if (key == "title")
        scenario_.title = scalar(value, key);
      else if (key == "hosts")
        read_hosts(value);
      else if (key == "defaults")
        flatten(value, "", defaults);
      else if (key == "order")
        interleaved = read_order(value);
      else if (key == "repeat")
        repeat = read_repeat(value);
      else if (key == "runs")
        runs = value;
      else
        fail(
            entry.first,
            fmt::format("unknown key '{}'; a scenario has title, hosts, defaults, order, repeat, runs", key));
    }
    if (!runs || !runs.IsSequence() || runs.size() == 0)
      fail(runs ? runs : root, "runs: a list of runs is needed");
    for (const auto& run : runs) read_run(run, defaults);
    check_only();
    scenario_.runs = repeated(interleaved, static_cast<int>(repeat));
    return std::move(scenario_);
  }

 private:
  [[noreturn]] void fail(const YAML::Mark& mark, const std::string& message) const {
    throw Error(2, fmt::format("{}:{}:{}: {}", scenario_.file, mark.line + 1, mark.column + 1, message));
  }
  [[noreturn]] void fail(const YAML::Node& node, const std::string& message) const {
    fail(node.Mark(), message);
  }

  std::string scalar(const YAML::Node& node, const std::string& key) const {
    if (!node.IsScalar() || node.Scalar().empty()) fail(node, key + ": a value is needed here");
    return node.Scalar();
  }

  // YAML forbids it, yaml-cpp lets the last one win.
  void once_each(const YAML::Node& map) const {
    std::set<std::string> seen;
    for (const auto& entry : map) {
      if (!entry.first.IsScalar()) fail(entry.first, "a key must be a word");
      if (!seen.insert(entry.first.Scalar()).second)
        fail(entry.first, fmt::format("'{}' is there twice", entry.first.Scalar()));
    }
  }

  void flatten(const YAML::Node& node, const std::string& prefix, Entries& entries) const {
    if (!node.IsMap())
      fail(node, prefix.empty() ? "keys and values are needed here" : prefix + ": a value is needed here");
    once_each(node);
    for (const auto& entry : node) {
      const auto path = prefix + entry.first.Scalar();
      if (entry.second.IsMap()) {
        flatten(entry.second, path + ".", entries);
        continue;
      }
      if (find_key(path) == nullptr && !is_option(path) && path != "id")
        fail(entry.first, fmt::format("unknown key '{}'{}", path, nearest(path)));
      entries[path] = entry.second;
    }
  }

  static const Key* find_key(const std::string& path) {
    const auto& all = keys();
    const auto found = std::find_if(all.begin(), all.end(), [&](const Key& key) { return key.path == path; });
    return found == all.end() ? nullptr : &*found;
  }

  // The keys that stand beside it, which is where a slip of the pen is found.
  static std::string nearest(const std::string& path) {
    const auto dot = path.rfind('.');
    const auto parent = dot == std::string::npos ? std::string() : path.substr(0, dot + 1);
    std::set<std::string> siblings;
    for (const auto& key : keys())
      if (key.path.starts_with(parent))
        siblings.insert(key.path.substr(parent.size(), key.path.find('.', parent.size()) - parent.size()));
    if (parent.empty()) siblings.insert({"id", "options"});
    if (siblings.empty()) return nearest(parent.substr(0, parent.size() - 1));
    return fmt::format("; here may stand: {}", fmt::join(siblings, ", "));
  }

  void read_hosts(const YAML::Node& node) {
    auto& hosts = scenario_.hosts;
    if (node.IsScalar()) {
      if (node.Scalar() == "namespaces")
        hosts.kind = Hosts::Kind::namespaces;
      else if (node.Scalar() == "loopback")
        hosts.kind = Hosts::Kind::loopback;
      else
        fail(node,
             fmt::format(
                 "hosts: '{}' is neither namespaces nor loopback, nor a map of controller and component",
                 node.Scalar()));
      return;
    }
    if (!node.IsMap()) fail(node, "hosts: namespaces, loopback, or a map of controller and component");
    once_each(node);
    hosts.kind = Hosts::Kind::stated;
    for (const auto& entry : node) {
      const auto name = entry.first.Scalar();
      if (name == "controller")
        hosts.controller = read_host(entry.second);
      else if (name == "component")
        hosts.component = read_host(entry.second);
      else
        fail(entry.first, fmt::format("hosts: unknown host '{}'; there are controller and component", name));
    }
    if (hosts.component.address.empty())
      fail(node, "hosts: component.address is needed: where the controller finds it");
  }

  Host read_host(const YAML::Node& node) const {
    if (!node.IsMap()) fail(node, "a host has prefix, interface, address");
    once_each(node);
    Host host;
    for (const auto& entry : node) {
      const auto key = entry.first.Scalar();
      const auto value = scalar(entry.second, key);
      if (key == "prefix") {
        std::istringstream words(value);
        for (std::string word; words >> word;) host.prefix.push_back(word);
      } else if (key == "interface") {
        host.interface = value;
      } else if (key == "address") {
        host.address = value;
      } else {
        fail(entry.first, fmt::format("unknown key '{}'; a host has prefix, interface, address", key));
      }
    }
    return host;
  }

  bool read_order(const YAML::Node& node) const {
    const auto word = scalar(node, "order");
    if (word != "interleaved" && word != "sequential")
      fail(node, fmt::format("order: '{}' is neither interleaved nor sequential", word));
    return word == "interleaved";
  }

  std::int64_t read_repeat(const YAML::Node& node) const {
    try {
      const auto times = std::stoll(scalar(node, "repeat"));
      if (times >= 1 && times <= 1'000'000 && std::to_string(times) == node.Scalar()) return times;
    } catch (const std::exception&) {  // said below
    }
    fail(node, fmt::format("repeat: '{}' is not a whole number from 1 to 1000000",
                           node.IsScalar() ? node.Scalar() : ""));
  }

  void read_run(const YAML::Node& node, const Entries& defaults) {
    auto entries = defaults;
    Entries own;
    if (!node.IsMap()) fail(node, "a run is a map of keys: id, transport, period …");
    flatten(node, "", own);
    if (!own.contains("id")) fail(node, "a run needs an id");
    const auto id = scalar(own["id"], "id");
    if (!ids_.insert(id).second) fail(own["id"], fmt::format("there is another run with id '{}'", id));
    for (const auto& [path, value] : own) {
      entries.erase(path);  // assigning to a YAML::Node would change what all its holders see
      entries.emplace(path, value);
    }
    entries.erase("id");
    if (selection_.only.empty() ||
        std::find(selection_.only.begin(), selection_.only.end(), id) != selection_.only.end())
      multiply(id, node, entries);
  }

  // One choice of a key that has several: a value and where it stands.
  struct Choice {
    std::string path, value;
    YAML::Node node;
  };

  std::vector<Choice> choices_of(const std::string& path, const YAML::Node& node) const {
    std::vector<Choice> choices;
    if (path == "transport" && !selection_.transports.empty()) {
      for (const auto& transport : selection_.transports) choices.push_back({path, transport, node});
    } else if (path == "duration" && selection_.duration) {
      choices.push_back({path, fmt::format("{} ns", selection_.duration->count()), node});
    } else if (node.IsSequence()) {
      for (const auto& element : node) choices.push_back({path, scalar(element, path), element});
      if (choices.empty()) fail(node, path + ": the list is empty");
    } else {
      choices.push_back({path, scalar(node, path), node});
    }
    return choices;
  }

  // Lists multiply: every combination of choices is a run.
  void multiply(const std::string& id, const YAML::Node& node, Entries entries) {
    if (!selection_.transports.empty()) entries.try_emplace("transport", node);
    if (selection_.duration) entries.try_emplace("duration", node);
    std::vector<std::vector<Choice>>
        dimensions;  // in the order of the table: a preset before what refines it
    for (const auto& key : keys())
      if (const auto entry = entries.find(key.path); entry != entries.end())
        dimensions.push_back(choices_of(entry->first, entry->second));
    for (const auto& [path, value] : entries)
      if (is_option(path)) dimensions.push_back(choices_of(path, value));

    std::vector<std::size_t> at(dimensions.size(), 0);
    while (true) {
      scenario_.runs.push_back(make_run(id, node, dimensions, at));
      std::size_t digit = dimensions.size();
      while (digit > 0 && ++at[digit - 1] == dimensions[digit - 1].size()) at[--digit] = 0;
      if (digit == 0) return;
    }
  }

  Run make_run(const std::string& id, const YAML::Node& node,
               const std::vector<std::vector<Choice>>& dimensions, const std::vector<std::size_t>& at) const {
    Run run;
    run.id = id;
    for (std::size_t i = 0; i < dimensions.size(); ++i) {
      const auto& choice = dimensions[i][at[i]];
      try {
        if (is_option(choice.path))
          set_option(run, choice.path, choice.value);
        else
          find_key(choice.path)->set(run, choice.value);
      } catch (const std::invalid_argument& error) {
        fail(choice.node, fmt::format("{}: {}", choice.path, error.what()));
      }
      if (dimensions[i].size() > 1 && choice.path != "transport")
        run.variant += fmt::format("{}{} {}", run.variant.empty() ? "" : ", ", choice.path, choice.value);
    }
    try {
      complete(run);
    } catch (const std::invalid_argument& error) {
      fail(node, fmt::format("run '{}': {}", id, error.what()));
    }
    return run;
  }

  void check_only() const {
    for (const auto& id : selection_.only)
      if (!ids_.contains(id))
        throw Error(2,
                    fmt::format("{} has no run '{}'; it has: {}", scenario_.file, id, fmt::join(ids_, ", ")));
  }

  // Interleaved, a drift of the machine falls on all runs alike.
  std::vector<Run> repeated(bool interleaved, int times) const {
    std::vector<Run> all;
    const auto& once = scenario_.runs;
    for (int i = 0; i < times * static_cast<int>(once.size()); ++i) {
      const auto n = static_cast<int>(once.size());
      all.push_back(once[static_cast<std::size_t>(interleaved ? i % n : i / times)]);
      all.back().repetition = 1 + (interleaved ? i / n : i % times);
    }
    return all;
  }

  const Selection& selection_;
  Scenario scenario_;
  std::set<std::string> ids_;
};

}  // namespace

Scenario read_scenario(const std::string& file, const Selection& selection) {
  return File(file, selection).read();
}

}  // namespace ontime::campaign

// SPDX-License-Identifier: Apache-2.0
// A scenario file: its keys are the fields of conditions; here are the file's shape and its errors.
#include "scenario/scenario.hpp"

#include <algorithm>
#include <iterator>
#include <set>
#include <stdexcept>
#include <string_view>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "gate/gate.hpp"
#include "scenario/complete.hpp"
#include "scenario/document.hpp"
#include "scenario/hosts.hpp"

namespace ontime::scenario {
namespace {

using conditions::Key, conditions::keys, conditions::number_of;

constexpr std::size_t most_runs = 100'000;  // with repetitions
constexpr std::size_t most_different_runs = 10'000;
constexpr std::size_t most_held = std::size_t{32} << 20U;  // bytes of keys and values of all runs together
constexpr std::size_t held_beside = 16;                    // of each, beside its words
constexpr std::size_t most_required = 100;

// The first key of it by which something of the interface itself is set; "": none is.
std::string of_an_interface(const Run& run) {
  for (const auto& setting : settings::table())
    if (setting.of_interface && run.kernel.contains(setting.name))
      return fmt::format("kernel.{}", setting.name);
  return run.isolation.interrupts ? "isolation.interrupts" : "";
}

// "": it can be measured over that wire.
std::string why_not_over(const conditions::Wire& wire, const Run& run) {
  if (wire.vlan > 0) {
    const auto name = of_an_interface(run);
    if (name.empty()) return "";
    return fmt::format(
        "{} is of the interface that takes packets in, and with wire.vlan that is not the messages', but the "
        "one below it: leave out {}, or wire.vlan",
        name, name);
  }
  if (wire.bits_per_s > 0 && any_past_the_kernel(run))
    return "xdp bypasses the interface's queueing disciplines, and wire.rate is one: use ethernet, or leave "
           "out wire.rate";
  if (wire.bits_per_s > 0 && (!run.faults.qdisc.empty() || run.faults.delay.count() > 0))
    return fmt::format(
        "wire.rate and {} both are the queueing discipline of the interface: say wire.vlan as well, whose "
        "interface has one of its own",
        run.faults.qdisc.empty() ? "link.delay" : "link.qdisc");
  return "";
}

// A run as written, flat: path ("qos.depth") → what stands there.
using Entries = std::map<std::string, YAML::Node>;

class File {
 public:
  File(const std::string& path, const std::string& text, const Selection& selection) : selection_(selection) {
    scenario_.file = path;
    scenario_.text = text;
  }

  Scenario read() {
    const auto root = document_of(scenario_.file, scenario_.text);
    if (!root.IsMap())
      throw Error(scenario_.file + ": not a scenario: it has no keys (title, hosts, defaults, runs …)");
    std::optional<YAML::Node> hosts, wire, defaults, runs, repeat;
    once_each(scenario_.file, root);
    for (const auto& entry : root) {
      const auto key = entry.first.Scalar();
      const auto& value = entry.second;
      if (key == "title")
        scenario_.title = scalar(value, key);
      else if (key == "hosts")
        hosts.emplace(value);
      else if (key == "wire")
        wire.emplace(value);
      else if (key == "components")
        components_.emplace(value);
      else if (key == "defaults")
        defaults.emplace(value);
      else if (key == "order")
        scenario_.interleaved = read_order(value);
      else if (key == "repeat")
        repeat.emplace(value);
      else if (key == "runs")
        runs.emplace(value);
      else
        fail(entry.first, fmt::format("unknown key '{}'; a scenario has title, hosts, wire, components, "
                                      "defaults, order, repeat, runs",
                                      key));
    }
    if (!runs || !runs->IsSequence() || runs->size() == 0)
      fail(runs.value_or(root), "runs: a list of runs is needed");
    scenario_.hosts = hosts_of(scenario_.file, hosts, components_);
    if (wire) lay_wire(scenario_.file, *wire, scenario_.hosts);
    const auto for_all = defaults ? read_defaults(*defaults) : Entries{};
    for (const auto& run : *runs) read_run(run, for_all);
    if (scenario_.runs.empty()) return std::move(scenario_);  // none is selected
    check_wire();
    if (repeat) read_repeat(*repeat);
    if (selection_.deploy) deploy();
    if (!selection_.cable.empty()) lay_cable(scenario_.file, selection_.cable, scenario_.hosts);
    return std::move(scenario_);
  }
  const std::set<std::string>& ids() const { return ids_; }  // selected or not

 private:
  [[noreturn]] void fail(const YAML::Mark& mark, const std::string& message) const {
    fail_at(scenario_.file, mark, message);
  }
  [[noreturn]] void fail(const YAML::Node& node, const std::string& message) const {
    fail(node.Mark(), message);
  }

  std::string scalar(const YAML::Node& node, const std::string& key) const {
    return scalar_of(scenario_.file, node, key);
  }

  Entries read_defaults(const YAML::Node& node) const {
    Entries defaults;
    flatten(node, "", defaults);
    if (const auto id = defaults.find("id"); id != defaults.end())
      fail(id->second, "id: each run has one of its own, under runs");
    return defaults;
  }

  // A key as it stands below a component's name, "arm.period", or for all.
  struct Said {
    std::string component;  // "": all
    std::string key;
  };
  Said divided(const std::string& path) const {
    const auto dot = path.find('.');
    auto name = path.substr(0, dot);
    if (!is_component(name)) return {"", path};
    return {std::move(name), dot == path.npos ? "" : path.substr(dot + 1)};
  }
  bool is_component(const std::string& name) const {
    const auto& all = scenario_.hosts.components;
    return components_ &&
           std::any_of(all.begin(), all.end(), [&](const auto& one) { return one.name == name; });
  }

  void flatten(const YAML::Node& node, const std::string& prefix, Entries& entries) const {
    if (!node.IsMap())
      fail(node, prefix.empty() ? "keys and values are needed here" : prefix + ": a value is needed here");
    once_each(scenario_.file, node);
    for (const auto& entry : node) {
      const auto path = prefix + entry.first.Scalar();
      if (entry.second.IsMap()) {
        flatten(entry.second, path + ".", entries);
        continue;
      }
      const auto [component, key] = divided(path);
      if (!component.empty() && key.empty())
        fail(entry.first, fmt::format("{0}: what holds for this component alone is needed here, such as {0}: "
                                      "{{period: 2 ms}}",
                                      component));
      if (!is_key(key) && !is_option(key) && key != "id" && key != "require") {
        if (const auto below = key_below(key); !below.empty())
          fail(entry.second,
               fmt::format("{0}: keys and values are needed here, such as {0}: {{{1}: …}}", path, below));
        fail(entry.first, fmt::format("unknown key '{}'{}", path, nearest(key)));
      }
      if (const auto reason = component.empty() ? "" : why_not_its_own(key); !reason.empty())
        fail(entry.first, fmt::format("{}: this cannot be said of one component: {}", path, reason));
      entries[path] = entry.second;
    }
  }

  // The controller's end of a component's link is its own behind a bridge, but for what sends there.
  std::string why_not_its_own(const std::string& key) const {
    const auto& hosts = scenario_.hosts;
    if (!key.starts_with("link.") || hosts.components.size() == 1) return common_to_all(key);
    if (hosts.kind == Hosts::Kind::stated)
      return "the controller's interface, which is one end of the link, is one for all";
    if (is_mark(key)) return "the controller gives it to all that it sends";
    return "";
  }

  static bool is_key(const std::string& path) {
    static const auto paths = [] {
      std::set<std::string> all;
      for (const auto& key : keys()) all.insert(key.path);
      return all;
    }();
    return paths.contains(path);
  }

  // The keys that stand beside it, which is where a slip of the pen is found.
  // "cpus" of "isolation"; "": it is no map.
  static std::string key_below(const std::string& path) {
    for (const auto& key : keys())
      if (key.path.starts_with(path + "."))
        return key.path.substr(path.size() + 1, key.path.find('.', path.size() + 1) - path.size() - 1);
    return "";
  }

  static std::string nearest(const std::string& path) {
    const auto dot = path.rfind('.');
    const auto parent = dot == std::string::npos ? std::string() : path.substr(0, dot + 1);
    std::set<std::string> siblings;
    for (const auto& key : keys())
      if (key.path.starts_with(parent))
        siblings.insert(key.path.substr(parent.size(), key.path.find('.', parent.size()) - parent.size()));
    if (parent.empty()) siblings.insert({"id", "options", "require"});
    if (siblings.empty()) return nearest(parent.substr(0, parent.size() - 1));
    return fmt::format("; allowed keys: {}", fmt::join(siblings, ", "));
  }

  void deploy() {
    auto& hosts = scenario_.hosts;
    const auto is_here = [](const auto& component) { return component.host.ssh.empty(); };
    if (hosts.controller.ssh.empty() &&
        std::all_of(hosts.components.begin(), hosts.components.end(), is_here))
      throw Error(
          fmt::format("--deploy brings ontime to hosts that are reached by ssh, and in {} there is "
                      "none (hosts: component: {{ssh: user@host …}})",
                      scenario_.file));
    hosts.deploy.emplace();
    const auto bring = [&](const Run& run) {
      hosts.deploy->insert({run.task.transport,
                            run.component_transport.empty() ? run.task.transport : run.component_transport});
    };
    for (const auto& run : scenario_.runs) {
      bring(run);
      for (const auto& own : run.own) bring(own);
    }
  }

  bool read_order(const YAML::Node& node) const {
    const auto word = scalar(node, "order");
    if (word != "interleaved" && word != "sequential")
      fail(node, fmt::format("order: '{}' is neither interleaved nor sequential", word));
    return word == "interleaved";
  }

  void read_repeat(const YAML::Node& node) {
    try {
      scenario_.repeat = static_cast<int>(number_of(scalar(node, "repeat"), 1, most_runs));
    } catch (const std::invalid_argument& error) {
      fail(node, fmt::format("repeat: {}", error.what()));
    }
    if (scenario_.size() > most_runs)
      fail(node, fmt::format("repeat: {} runs, {} times, are {}; a scenario has at most {}",
                             scenario_.runs.size(), scenario_.repeat, scenario_.size(), most_runs));
  }

  void read_run(const YAML::Node& node, const Entries& defaults) {
    Entries own;
    if (!node.IsMap()) fail(node, "a run is a map of keys: id, transport, period …");
    flatten(node, "", own);
    if (!own.contains("id")) fail(node, "a run needs an id");
    const auto id = scalar(own["id"], "id");
    if (!ids_.insert(id).second) fail(own["id"], fmt::format("there is another run with id '{}'", id));
    own.erase("id");
    if (!selection_.only.empty() &&
        std::find(selection_.only.begin(), selection_.only.end(), id) == selection_.only.end())
      return;
    hold(id, node, defaults.size() * held_beside);
    own.insert(defaults.begin(), defaults.end());  // where the run says nothing
    const auto required = take_require(own);
    multiply(id, node, required, std::move(own));
  }

  using Required = std::map<std::string, std::vector<std::string>>;  // by component; "": all
  Required take_require(Entries& entries) const {
    Required required;
    for (auto entry = entries.begin(); entry != entries.end();) {
      const auto [component, key] = divided(entry->first);
      if (key == "require") required[component] = read_require(entry->second);
      entry = key == "require" ? entries.erase(entry) : std::next(entry);
    }
    return required;
  }

  void check_wire() const {
    if (!scenario_.hosts.wire.any()) return;
    for (const auto& of_all : scenario_.runs)
      for (const auto& run : together(of_all, scenario_.hosts))
        if (const auto why = why_not_over(scenario_.hosts.wire, run); !why.empty())
          throw Error(fmt::format("{}: {}: {}", scenario_.file, run.id, why));
  }

  // A list that does not multiply: all of it must be so.
  std::vector<std::string> read_require(const YAML::Node& node) const {
    std::vector<std::string> gates;
    const auto read = [&](const YAML::Node& gate) {
      gates.push_back(scalar(gate, "require"));
      try {
        gate::parse(gates.back(), gate::Use::require);
      } catch (const gate::Error& error) {
        fail(gate, fmt::format("require: '{}', {}", gates.back(), error.what()));
      }
    };
    if (!node.IsSequence())
      read(node);
    else
      for (const auto& gate : node) read(gate);
    if (gates.size() > most_required) fail(node, fmt::format("require: at most {} of a run", most_required));
    return gates;
  }

  // Lists, and defaults that hold for many runs, could make more of a small file than there is memory for.
  void hold(const std::string& id, const YAML::Node& node, std::size_t bytes) {
    held_ += bytes;
    if (held_ > most_held)
      fail(node, fmt::format("run '{}': the runs until here hold more than {} MiB of keys and values; make "
                             "several scenarios of them",
                             id, most_held >> 20U));
  }

  // One choice of a key that has several, and where it stands.
  struct Choice {
    std::string value;
    YAML::Node node;
  };
  struct Dimension {
    std::string path;
    const Key* key;  // nothing: a transport's option
    std::vector<Choice> choices;
    Said said;
  };

  std::vector<Choice> choices_of(const std::string& path, const YAML::Node& node) const {
    std::vector<Choice> choices;
    if (path == "transport" && !selection_.transports.empty()) {
      for (const auto& transport : selection_.transports) choices.push_back({transport, node});
    } else if (path == "duration" && selection_.duration) {
      choices.push_back({fmt::format("{} ns", selection_.duration->count()), node});
    } else if (path == "explain" && selection_.explain) {
      choices.push_back({"on", node});
    } else if (const auto chosen = selection_.set.find(path); chosen != selection_.set.end()) {
      choices.push_back({chosen->second, node});
    } else if (node.IsSequence()) {
      for (const auto& element : node) choices.push_back({scalar(element, path), element});
      if (choices.empty()) fail(node, path + ": the list is empty");
    } else {
      choices.push_back({scalar(node, path), node});
    }
    std::set<std::string_view> seen;
    for (const auto& choice : choices)
      if (!seen.insert(choice.value).second)
        fail(choice.node, fmt::format("{}: '{}' occurs twice", path, choice.value));
    return choices;
  }

  // Lists multiply: every combination of choices is a run.
  void multiply(const std::string& id, const YAML::Node& node, const Required& required, Entries entries) {
    if (!selection_.transports.empty()) {
      std::erase_if(entries, [&](const auto& entry) {
        const auto [component, key] = divided(entry.first);
        return !component.empty() && key == "transport";
      });
      entries.try_emplace("transport", node);
    }
    if (selection_.duration) entries.try_emplace("duration", node);
    if (selection_.explain) entries.try_emplace("explain", node);
    for (const auto& [path, value] : selection_.set) {
      if (!is_key(path) && !is_option(path))
        throw Error(fmt::format("there is no key '{}'{}", path, nearest(path)));
      entries.try_emplace(path, node);
    }
    std::vector<Dimension> dimensions;  // in the order of the table: a preset before what refines it
    for (const auto& key : keys())
      for (const auto& [path, value] : entries)
        if (auto said = divided(path); said.key == key.path)
          dimensions.push_back({path, &key, choices_of(path, value), std::move(said)});
    for (const auto& [path, value] : entries)
      if (auto said = divided(path); is_option(said.key))
        dimensions.push_back({path, nullptr, choices_of(path, value), std::move(said)});
    const auto searched = search_last(dimensions);

    std::set<std::string> owners;  // and all, as one
    for (const auto& dimension : dimensions) owners.insert(dimension.said.component);
    for (const auto& [component, gates] : required) owners.insert(component);
    if (std::any_of(owners.begin(), owners.end(), [](const auto& owner) { return !owner.empty(); }))
      for (const auto& component : scenario_.hosts.components) owners.insert(component.name);
    owners.insert("");

    std::size_t combinations = owners.size(), bytes = 0;
    for (const auto& [component, gates] : required)
      for (const auto& gate : gates) bytes += gate.size() + held_beside;
    for (const auto& [path, key, choices, said] : dimensions) {
      combinations *= choices.size();
      if (different_ + combinations > most_different_runs)
        fail(node,
             fmt::format("run '{}': with every combination of its lists there are more than {} different "
                         "runs; make several scenarios of them",
                         id, most_different_runs));
      std::size_t longest = 0;
      for (const auto& choice : choices) longest = std::max(longest, choice.value.size());
      bytes += path.size() + longest + held_beside;
    }
    different_ += combinations;
    hold(id, node, combinations * bytes);

    std::vector<std::size_t> at(dimensions.size(), 0);
    while (true) {
      scenario_.runs.push_back(make_runs(id, node, dimensions, at, owners));
      auto& run = scenario_.runs.back();
      if (searched) make_step(run.step, dimensions.back().choices, at.back());
      if (const auto gates = required.find(""); gates != required.end()) run.require = gates->second;
      for (auto& own : run.own) {
        const auto gates = required.find(own.component);
        own.require = gates != required.end() ? gates->second : run.require;
      }
      std::size_t digit = dimensions.size();
      while (digit > 0 && ++at[digit - 1] == dimensions[digit - 1].choices.size()) at[--digit] = 0;
      if (digit == 0) return;
    }
  }

  // The key that is searched becomes the last, so that its values follow one another. False: there is none.
  bool search_last(std::vector<Dimension>& dimensions) const {
    const auto at = [&](const std::string& path) {
      return std::find_if(dimensions.begin(), dimensions.end(),
                          [&](const auto& d) { return d.path == path; });
    };
    const auto search = at("search");
    if (search == dimensions.end()) return false;
    if (search->choices.size() > 1) fail(search->choices[1].node, "search: one key at a time");
    const auto [path, node] = search->choices.front();
    const auto key = at(path);
    if (key == dimensions.end() || key->choices.size() < 2)
      fail(node, fmt::format("search: '{}' is no key of this run with a list of values, from the gentlest to "
                             "the harshest",
                             path));
    if (key->said.key == "transport") fail(node, "search: transports have no order from gentle to harsh");
    std::rotate(key, key + 1, dimensions.end());
    return true;
  }

  static void make_step(Run::Step& step, const std::vector<Choice>& choices, std::size_t number) {
    step.value = choices[number].value;
    step.number = static_cast<int>(number);
    step.of = static_cast<int>(choices.size());
  }

  // Of all, and, where any has something of its own, of each: what varies for one is beside the others.
  Run make_runs(const std::string& id, const YAML::Node& node, const std::vector<Dimension>& dimensions,
                const std::vector<std::size_t>& at, const std::set<std::string>& owners) const {
    auto run = make_run(id, node, dimensions, at, "");
    for (const auto& component : owners)
      if (!component.empty()) run.own.push_back(make_run(id, node, dimensions, at, component));
    try {
      const auto all = together(run, scenario_.hosts);
      check_addresses(all);
      check_queues(all);
    } catch (const std::invalid_argument& error) {
      fail(node, fmt::format("run '{}': {}", id, error.what()));
    }
    return run;
  }

  // Of all components, or of one by its name, where what is said of it alone comes before what is of all.
  Run make_run(const std::string& id, const YAML::Node& node, const std::vector<Dimension>& dimensions,
               const std::vector<std::size_t>& at, const std::string& component) const {
    Run run;
    run.id = id;
    run.where = fmt::format("{}:{}", scenario_.file, node.Mark().line + 1);
    if (!component.empty()) run.component = component;
    const auto holds_for_it = [&](const Said& said) {
      return said.component == component ||
             (said.component.empty() && !is_said_anew(dimensions, said.key, component));
    };
    for (const bool its_own : {false, true})
      for (std::size_t i = 0; i < dimensions.size(); ++i)
        if (const auto& said = dimensions[i].said; said.component.empty() != its_own && holds_for_it(said))
          set(run, dimensions[i], dimensions[i].choices[at[i]]);
    for (std::size_t i = 0; i < dimensions.size(); ++i) {
      const auto& [path, key, choices, said] = dimensions[i];
      const auto& choice = choices[at[i]];
      const bool holds = holds_for_it(said);
      if (&dimensions[i] == &dimensions.back()) run.step.among = run.variant;
      if (choices.size() == 1 || (holds && said.key == "transport")) continue;
      const auto& name = holds ? said.key : path;
      const bool of_others = !holds && !component.empty();
      auto& text = of_others ? run.beside : run.variant;
      if (!of_others) run.varied.emplace_back(name, choice.value);
      text += fmt::format("{}{} {}", text.empty() ? "" : ", ", name, choice.value);
    }
    try {
      complete(run);
    } catch (const std::invalid_argument& error) {
      fail(node, fmt::format("run '{}'{}: {}", id, component.empty() ? "" : ", " + component, error.what()));
    }
    return run;
  }

  // By that key, or, of "realtime", by one below it.
  static bool is_said_anew(const std::vector<Dimension>& dimensions, const std::string& key,
                           const std::string& component) {
    if (component.empty()) return false;
    return std::any_of(dimensions.begin(), dimensions.end(), [&](const Dimension& other) {
      return other.said.component == component &&
             (other.said.key == key || other.said.key.starts_with(key + "."));
    });
  }

  void set(Run& run, const Dimension& dimension, const Choice& choice) const {
    try {
      check_behind_a_bridge(dimension.path);
      if (dimension.key == nullptr)
        set_option(run, dimension.said.key, choice.value);
      else
        dimension.key->set(run, choice.value);
    } catch (const std::invalid_argument& error) {
      fail(choice.node, fmt::format("{}: {}", dimension.path, error.what()));
    }
  }

  // What the bridge has not by which several namespaces are joined.
  void check_behind_a_bridge(const std::string& path) const {
    const auto& hosts = scenario_.hosts;
    if (hosts.kind != Hosts::Kind::namespaces || hosts.components.size() == 1) return;
    for (const auto* of_ports :
         {"kernel.gro", "kernel.threaded-napi", "kernel.napi-threads", "kernel.napi-cpus"})
      if (path == of_ports)
        throw std::invalid_argument(
            "several components in namespaces are joined by a bridge, which takes in no packets itself: "
            "leave it out, or components");
  }

  // By which alone udp tells components apart; and iperf3, which listens there.
  void check_addresses(const Together& all) const {
    std::map<std::string, std::string> of_udp, of_traffic;
    const auto check = [](auto& names, const char* whose, const std::string& address, const Run& run) {
      if (address.empty()) return;
      if (const auto [other, is_first] = names.emplace(address, run.component); !is_first)
        throw std::invalid_argument(
            fmt::format("{} each component has its own address, and {} and {} have the same: {}", whose,
                        other->second, run.component, address));
    };
    for (const auto& run : all) {
      const auto& address = scenario_.hosts.at(run.component).address;
      if (run.task.transport == "udp") check(of_udp, "over udp", address, run);
      if (run.traffic.bits_per_s > 0) check(of_traffic, "with traffic", without_port(address), run);
    }
  }

  // The controller's ends of all are on one interface, of which each would take the queue and the place of an
  // XDP program.
  static void check_queues(const Together& all) {
    const Run* first = nullptr;
    for (const auto& run : all) {
      if (!is_past_the_kernel(run.task.transport)) continue;
      if (first != nullptr)
        throw std::invalid_argument(
            fmt::format("over xdp {} and {} would share a queue at the controller, and each end takes one "
                        "for itself: take "
                        "ethernet for all but one",
                        first->component, run.component));
      first = &run;
    }
  }

  const Selection& selection_;
  Scenario scenario_;
  std::optional<YAML::Node> components_;
  std::set<std::string> ids_;
  std::size_t different_ = 0, held_ = 0;
};

std::string some_of(const std::set<std::string>& ids) {
  constexpr std::size_t enough = 20;
  const auto shown = std::min(ids.size(), enough);
  const auto end = std::next(ids.begin(), static_cast<std::ptrdiff_t>(shown));
  return fmt::format("{}{}", fmt::join(ids.begin(), end, ", "), shown < ids.size() ? " …" : "");
}

// `which_have`: "demo.yaml has".
void check_only(const Selection& selection, const std::set<std::string>& ids, const std::string& which_have) {
  for (const auto& id : selection.only)
    if (!ids.contains(id))
      throw Error(fmt::format("{} no run '{}'; there are: {}", which_have, id, some_of(ids)));
}

}  // namespace

Run Scenario::at(std::size_t number) const {
  const auto times = static_cast<std::size_t>(repeat);
  auto run = runs.at(interleaved ? number % runs.size() : number / times);
  run.repetition = 1 + static_cast<int>(interleaved ? number / runs.size() : number % times);
  return run;
}

std::chrono::duration<double> time_of(const Run& run) {
  constexpr std::chrono::duration<double> beside(
      2);  // start, matching, the account; as seen with three transports
  const auto warm_up = [](const Run& one) {
    return static_cast<double>(one.task.client.warm_up) * one.task.client.period;
  };
  std::chrono::duration<double> longest = warm_up(run);  // all warm up before any begins
  for (const auto& own : run.own) longest = std::max<std::chrono::duration<double>>(longest, warm_up(own));
  return beside + run.task.client.duration + longest;
}

std::chrono::duration<double> time_of(const Scenario& scenario) {
  std::chrono::duration<double> once{0};
  for (const auto& run : scenario.runs) once += time_of(run);
  return once * scenario.repeat;
}

Scenario read_scenario(const std::string& file, const Selection& selection) {
  return parse_scenario(file, text_of(file), selection);
}

Scenario parse_scenario(const std::string& file, const std::string& text, const Selection& selection) {
  File reader(file, text, selection);
  auto scenario = reader.read();
  check_only(selection, reader.ids(), file + " has");
  return scenario;
}

std::vector<Scenario> read_scenarios(const std::vector<std::string>& files, const Selection& selection) {
  std::vector<Scenario> scenarios;
  std::set<std::string> ids;
  for (const auto& name : files) {
    File file(name, text_of(name), selection);
    if (auto scenario = file.read(); !scenario.runs.empty()) scenarios.push_back(std::move(scenario));
    ids.insert(file.ids().begin(), file.ids().end());
  }
  check_only(
      selection, ids,
      files.size() == 1 ? files.front() + " has" : fmt::format("these {} scenarios have", files.size()));
  return scenarios;
}

}  // namespace ontime::scenario

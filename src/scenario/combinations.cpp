// SPDX-License-Identifier: Apache-2.0
#include "scenario/combinations.hpp"

#include <algorithm>
#include <stdexcept>
#include <string_view>

#include <fmt/format.h>

#include "scenario/complete.hpp"
#include "scenario/document.hpp"

namespace ontime::scenario {
namespace {

constexpr std::size_t most_different_runs = 10'000;
constexpr std::size_t most_held = std::size_t{32} << 20U;  // bytes of keys and values of all runs together
constexpr std::size_t held_beside = 16;                    // of each, beside its words

// What the bridge has not by which several namespaces are joined.
void check_behind_a_bridge(const std::string& path, const Hosts& hosts) {
  if (hosts.kind != Hosts::Kind::namespaces || hosts.components.size() == 1) return;
  for (const auto* of_ports :
       {"kernel.gro", "kernel.threaded-napi", "kernel.napi-threads", "kernel.napi-cpus"})
    if (path == of_ports)
      throw std::invalid_argument(
          "several components in namespaces are joined by a bridge, which takes in no packets itself: "
          "leave it out, or components");
}

// By which alone a transport without topics tells components apart; and iperf3, which listens there.
void check_addresses(const Together& all, const Hosts& hosts) {
  std::map<std::string, std::string> of_transport, of_traffic;
  const auto check = [](auto& names, const std::string& whose, const std::string& address, const Run& run) {
    if (address.empty()) return;
    if (const auto [other, is_first] = names.emplace(address, run.component); !is_first)
      throw std::invalid_argument(
          fmt::format("{} each component has its own address, and {} and {} have the same: {}", whose,
                      other->second, run.component, address));
  };
  for (const auto& run : all) {
    const auto& address = hosts.at(run.component).address;
    if (has_no_topics(run.task.transport)) check(of_transport, "over " + run.task.transport, address, run);
    if (run.traffic.bits_per_s > 0) check(of_traffic, "with traffic", without_port(address), run);
  }
}

// The controller's ends of all are on one interface, of which each would take the queue and the place of an
// XDP program.
void check_queues(const Together& all) {
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

}  // namespace

void Combinations::fail(const YAML::Node& node, const std::string& message) const {
  fail_at(file_, node.Mark(), message);
}

std::vector<Run> Combinations::of(const std::string& id, const YAML::Node& node, const Required& required,
                                  Entries entries) {
  hold(id, node, entries.size() * held_beside);
  add_selected(entries, node);
  auto dimensions = dimensions_of(entries);
  const auto searched = search_last(dimensions);
  const auto owners = owners_of(dimensions, required);
  bound(id, node, required, dimensions, owners.size());

  std::vector<Run> runs;
  std::vector<std::size_t> at(dimensions.size(), 0);
  while (true) {
    auto& run = runs.emplace_back(make_runs(id, node, dimensions, at, owners));
    if (searched) make_step(run.step, dimensions.back().choices, at.back());
    if (const auto gates = required.find(""); gates != required.end()) run.require = gates->second;
    for (auto& own : run.own) {
      const auto gates = required.find(own.component);
      own.require = gates != required.end() ? gates->second : run.require;
    }
    std::size_t digit = dimensions.size();
    while (digit > 0 && ++at[digit - 1] == dimensions[digit - 1].choices.size()) at[--digit] = 0;
    if (digit == 0) return runs;
  }
}

void Combinations::add_selected(Entries& entries, const YAML::Node& node) const {
  if (!selection_.transports.empty()) {
    std::erase_if(entries, [&](const auto& entry) {
      const auto [component, key] = keys_.divided(entry.first);
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
}

// In the order of the table: a preset before what refines it.
Combinations::Dimensions Combinations::dimensions_of(const Entries& entries) const {
  Dimensions dimensions;
  for (const auto& key : conditions::keys())
    for (const auto& [path, value] : entries)
      if (auto said = keys_.divided(path); said.key == key.path)
        dimensions.push_back({path, &key, choices_of(path, value), std::move(said)});
  for (const auto& [path, value] : entries)
    if (auto said = keys_.divided(path); is_option(said.key))
      dimensions.push_back({path, nullptr, choices_of(path, value), std::move(said)});
  return dimensions;
}

std::vector<Combinations::Choice> Combinations::choices_of(const std::string& path,
                                                           const YAML::Node& node) const {
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
    for (const auto& element : node) choices.push_back({scalar_of(file_, element, path), element});
    if (choices.empty()) fail(node, path + ": the list is empty");
  } else {
    choices.push_back({scalar_of(file_, node, path), node});
  }
  std::set<std::string_view> seen;
  for (const auto& choice : choices)
    if (!seen.insert(choice.value).second)
      fail(choice.node, fmt::format("{}: '{}' occurs twice", path, choice.value));
  return choices;
}

// Each component of which anything is said alone, and all, as one ("").
std::set<std::string> Combinations::owners_of(const Dimensions& dimensions, const Required& required) const {
  std::set<std::string> owners;
  for (const auto& dimension : dimensions) owners.insert(dimension.said.component);
  for (const auto& [component, gates] : required) owners.insert(component);
  if (std::any_of(owners.begin(), owners.end(), [](const auto& owner) { return !owner.empty(); }))
    for (const auto& component : hosts_.components) owners.insert(component.name);
  owners.insert("");
  return owners;
}

void Combinations::bound(const std::string& id, const YAML::Node& node, const Required& required,
                         const Dimensions& dimensions, std::size_t owners) {
  std::size_t combinations = owners, bytes = 0;
  for (const auto& [component, gates] : required)
    for (const auto& gate : gates) bytes += gate.size() + held_beside;
  for (const auto& [path, key, choices, said] : dimensions) {
    combinations *= choices.size();
    if (different_ + combinations > most_different_runs)
      fail(node, fmt::format("run '{}': with every combination of its lists there are more than {} different "
                             "runs; make several scenarios of them",
                             id, most_different_runs));
    std::size_t longest = 0;
    for (const auto& choice : choices) longest = std::max(longest, choice.value.size());
    bytes += path.size() + longest + held_beside;
  }
  different_ += combinations;
  hold(id, node, combinations * bytes);
}

// Lists, and defaults that hold for many runs, could make more of a small file than there is memory for.
void Combinations::hold(const std::string& id, const YAML::Node& node, std::size_t bytes) {
  held_ += bytes;
  if (held_ > most_held)
    fail(node, fmt::format("run '{}': the runs until here hold more than {} MiB of keys and values; make "
                           "several scenarios of them",
                           id, most_held >> 20U));
}

// The key that is searched becomes the last, so that its values follow one another. False: there is none.
bool Combinations::search_last(Dimensions& dimensions) const {
  const auto at = [&](const std::string& path) {
    return std::find_if(dimensions.begin(), dimensions.end(), [&](const auto& d) { return d.path == path; });
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

void Combinations::make_step(Run::Step& step, const std::vector<Choice>& choices, std::size_t number) {
  step.value = choices[number].value;
  step.number = static_cast<int>(number);
  step.of = static_cast<int>(choices.size());
}

// Of all, and, where any has something of its own, of each: what varies for one is beside the others.
Run Combinations::make_runs(const std::string& id, const YAML::Node& node, const Dimensions& dimensions,
                            const std::vector<std::size_t>& at, const std::set<std::string>& owners) const {
  auto run = make_run(id, node, dimensions, at, "");
  for (const auto& component : owners)
    if (!component.empty()) run.own.push_back(make_run(id, node, dimensions, at, component));
  try {
    const auto all = together(run, hosts_);
    check_addresses(all, hosts_);
    check_queues(all);
  } catch (const std::invalid_argument& error) {
    fail(node, fmt::format("run '{}': {}", id, error.what()));
  }
  return run;
}

// Of all components, or of one by its name, where what is said of it alone comes before what is of all.
Run Combinations::make_run(const std::string& id, const YAML::Node& node, const Dimensions& dimensions,
                           const std::vector<std::size_t>& at, const std::string& component) const {
  Run run;
  run.id = id;
  run.where = fmt::format("{}:{}", file_, node.Mark().line + 1);
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
bool Combinations::is_said_anew(const Dimensions& dimensions, const std::string& key,
                                const std::string& component) {
  if (component.empty()) return false;
  return std::any_of(dimensions.begin(), dimensions.end(), [&](const Dimension& other) {
    return other.said.component == component &&
           (other.said.key == key || other.said.key.starts_with(key + "."));
  });
}

void Combinations::set(Run& run, const Dimension& dimension, const Choice& choice) const {
  try {
    check_behind_a_bridge(dimension.path, hosts_);
    if (dimension.key == nullptr)
      set_option(run, dimension.said.key, choice.value);
    else
      dimension.key->set(run, choice.value);
  } catch (const std::invalid_argument& error) {
    fail(choice.node, fmt::format("{}: {}", dimension.path, error.what()));
  }
}

}  // namespace ontime::scenario

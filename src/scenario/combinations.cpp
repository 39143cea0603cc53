// SPDX-License-Identifier: Apache-2.0
#include "scenario/combinations.hpp"

#include <algorithm>
#include <set>
#include <stdexcept>

#include <fmt/format.h>

#include "scenario/complete.hpp"
#include "scenario/document.hpp"

namespace ontime::scenario {
namespace {

constexpr std::size_t most_different_runs = 10'000;
constexpr std::size_t most_held = std::size_t{32} << 20U;  // bytes of keys and values of all runs together
constexpr std::size_t held_beside = 16;                    // of each, beside its words

// Keys that have no effect on a bridge between several namespaces.
void check_behind_a_bridge(const std::string& path, const Hosts& hosts) {
  if (hosts.kind != Hosts::Kind::namespaces || hosts.components.size() == 1) return;
  for (const auto* of_ports :
       {"kernel.gro", "kernel.threaded-napi", "kernel.napi-threads", "kernel.napi-cpus"})
    if (path == of_ports)
      refuse(
          "a bridge joins several components in namespaces and receives no packets itself: leave out this "
          "key or components");
}

// Transports without topics, and iperf3, tell components apart only by address.
void check_addresses(const Together& all, const Hosts& hosts) {
  std::map<std::string, std::string> of_transport, of_traffic;
  const auto check = [](auto& names, const std::string& reason, const std::string& address, const Run& run) {
    if (address.empty()) return;
    if (const auto [other, is_first] = names.emplace(address, run.component); !is_first)
      refuse("{} and {} have the same address, {}: each component needs its own {}", other->second,
             run.component, address, reason);
  };
  for (const auto& run : all) {
    const auto& address = hosts.at(run.component).address;
    if (has_no_topics(run.task.transport)) check(of_transport, "over " + run.task.transport, address, run);
    if (run.traffic.bits_per_s > 0) check(of_traffic, "with traffic", without_port(address), run);
  }
}

// All controller ends share one interface, which has one XDP program and one queue for it.
void check_queues(const Together& all) {
  const Run* first = nullptr;
  for (const auto& run : all) {
    if (!is_past_the_kernel(run.task.transport)) continue;
    if (first != nullptr)
      refuse(
          "over {}, {} and {} need a queue each, but the controller has one for both. Use {} for "
          "all but one",
          run.task.transport, first->component, run.component,
          other_transports(&transport::Capabilities::past_the_kernel, false));
    first = &run;
  }
}

// One choice of a key that has several, and where it stands.
struct Choice {
  std::string value;
  YAML::Node node;
};
struct Dimension {
  std::string path;
  const conditions::Key* key;  // null: a transport's option
  std::vector<Choice> choices;
  Said said;
};

// '10 ms' and '0.01 s' are one value. A value that is refused later is its text.
std::string value_of(const conditions::Key* key, const std::string& text) try {
  return key == nullptr || !key->stated ? text : key->stated(text).dump();
} catch (const std::exception&) {
  return text;
}

// The runs that one entry of `runs` makes.
class Combinations {
 public:
  Combinations(Origin& origin, const std::string& id, const YAML::Node& node, const Required& required)
      : origin_(origin), id_(id), node_(node), required_(required) {}

  std::vector<Run> of(Entries entries) {
    hold(entries.size() * held_beside);
    add_selected(entries);
    add_dimensions(entries);
    const auto searched = search_last();
    const auto owners = owners_of_all();
    bound(owners.size());

    std::vector<Run> runs;
    at_.assign(dimensions_.size(), 0);
    while (true) {
      auto& run = runs.emplace_back(make_runs(owners));
      if (searched) {
        run.step.key = dimensions_.back().path;
        const auto& steps = dimensions_.back().choices;
        run.step.value = steps[at_.back()].value;
        run.step.number = static_cast<int>(at_.back());
        run.step.of = static_cast<int>(steps.size());
      }
      if (const auto gates = required_.find(""); gates != required_.end()) run.require = gates->second;
      for (auto& own : run.own) {
        const auto gates = required_.find(own.component);
        own.require = gates != required_.end() ? gates->second : run.require;
      }
      std::size_t digit = dimensions_.size();
      while (digit > 0 && ++at_[digit - 1] == dimensions_[digit - 1].choices.size()) at_[--digit] = 0;
      if (digit == 0) return runs;
    }
  }

 private:
  template <class... Values>
  [[noreturn]] void fail(const YAML::Node& node, fmt::format_string<Values...> text,
                         Values&&... values) const {
    fail_at(origin_.file, node.Mark(), text, std::forward<Values>(values)...);
  }

  void add_selected(Entries& entries) const {
    const auto& selection = origin_.selection;
    if (!selection.transports.empty()) {
      std::erase_if(entries, [&](const auto& entry) {
        const auto [component, key] = origin_.keys.divided(entry.first);
        return !component.empty() && key == "transport";
      });
      entries.try_emplace("transport", node_);
    }
    if (selection.duration) entries.try_emplace("duration", node_);
    if (selection.explain) entries.try_emplace("explain", node_);
    for (const auto& [path, value] : selection.set) {
      if (!is_key(path) && !is_option(path))
        throw Error(fmt::format("unknown key '{}'{}", path, meant_of(path)));
      entries.try_emplace(path, node_);
    }
  }

  // In the order of the table: a preset before what refines it.
  void add_dimensions(const Entries& entries) {
    for (const auto& key : conditions::keys())
      for (const auto& [path, value] : entries)
        if (auto said = origin_.keys.divided(path); said.key == key.path)
          dimensions_.push_back({path, &key, choices_of(&key, path, value), std::move(said)});
    for (const auto& [path, value] : entries)
      if (auto said = origin_.keys.divided(path); is_option(said.key))
        dimensions_.push_back({path, nullptr, choices_of(nullptr, path, value), std::move(said)});
  }

  std::vector<Choice> choices_of(const conditions::Key* key, const std::string& path,
                                 const YAML::Node& node) const {
    const auto& selection = origin_.selection;
    std::vector<Choice> choices;
    if (path == "transport" && !selection.transports.empty()) {
      for (const auto& transport : selection.transports) choices.push_back({transport, node});
    } else if (path == "duration" && selection.duration) {
      choices.push_back({fmt::format("{} ns", selection.duration->count()), node});
    } else if (path == "explain" && selection.explain) {
      choices.push_back({"on", node});
    } else if (const auto chosen = selection.set.find(path); chosen != selection.set.end()) {
      choices.push_back({chosen->second, node});
    } else if (node.IsSequence()) {
      for (const auto& element : node) choices.push_back({scalar_of(origin_.file, element, path), element});
      if (choices.empty()) fail(node, "{}: the list is empty", path);
    } else {
      choices.push_back({scalar_of(origin_.file, node, path), node});
    }
    std::map<std::string, std::string> seen;
    for (const auto& [value, where] : choices) {
      const auto [first, is_new] = seen.emplace(value_of(key, value), value);
      if (is_new) continue;
      if (first->second == value) fail(where, "{}: '{}' occurs twice", path, value);
      fail(where, "{}: '{}' and '{}' are one value", path, first->second, value);
    }
    return choices;
  }

  // Each component with keys of its own, and all together ("").
  std::set<std::string> owners_of_all() const {
    std::set<std::string> owners{""};
    for (const auto& dimension : dimensions_) owners.insert(dimension.said.component);
    for (const auto& [component, gates] : required_) owners.insert(component);
    if (owners.size() > 1)
      for (const auto& component : origin_.hosts.components) owners.insert(component.name);
    return owners;
  }

  void bound(std::size_t owners) {
    std::size_t combinations = owners, bytes = 0;
    for (const auto& [component, gates] : required_)
      for (const auto& gate : gates) bytes += gate.size() + held_beside;
    for (const auto& [path, key, choices, said] : dimensions_) {
      combinations *= choices.size();
      if (origin_.different + combinations > most_different_runs)
        fail(node_, "run '{}': its lists combine to more than {} different runs; split the scenario", id_,
             most_different_runs);
      std::size_t longest = 0;
      for (const auto& choice : choices) longest = std::max(longest, choice.value.size());
      bytes += path.size() + longest + held_beside;
    }
    origin_.different += combinations;
    hold(combinations * bytes);
  }

  // Lists, and defaults that hold for many runs, could make more of a small file than there is memory for.
  void hold(std::size_t bytes) {
    origin_.held += bytes;
    if (origin_.held > most_held)
      fail(node_,
           "run '{}': the runs up to here hold more than {} MiB of keys and values; split the scenario", id_,
           most_held >> 20U);
  }

  // Makes the searched key the last, so that its values follow one another. False: no key is searched.
  bool search_last() {
    const auto at = [&](const std::string& path) {
      return std::ranges::find(dimensions_, path, &Dimension::path);
    };
    const auto search = at("search");
    if (search == dimensions_.end()) return false;
    if (search->choices.size() > 1) fail(search->choices[1].node, "search: one key at a time");
    const auto& [stated, node] = search->choices.front();
    const auto path = origin_.keys.current(stated);
    const auto key = at(path);
    if (const auto name = origin_.keys.divided(path).key; !is_key(name) && !is_option(name))
      fail(node, "search: unknown key '{}'{}", path, meant_of(name));
    if (key == dimensions_.end() || key->choices.size() < 2)
      fail(node, "search: '{}' has no list of values in this run; list them from lightest to heaviest", path);
    if (key->said.key == "transport")
      fail(node, "search: transports have no order from lightest to heaviest");
    check_order(*key);
    std::rotate(key, key + 1, dimensions_.end());
    return true;
  }

  // A search skips values: without an order its result says nothing of these. Only quantities with a unit
  // have one of their own: a number may be a label (domain, dscp), and `none` the greatest or the least.
  void check_order(const Dimension& key) const {
    if (key.key == nullptr || !key.key->stated) return;
    std::vector<double> quantities;
    for (const auto& choice : key.choices) try {
        const auto value = key.key->stated(choice.value);
        const auto unit = choice.value.find_first_not_of("0123456789.");
        if (!value.is_number() || unit == 0 || unit == std::string::npos) return;
        quantities.push_back(value.get<double>());
      } catch (const std::exception&) {  // refused later, with its place
        return;
      }
    if (!std::ranges::is_sorted(quantities) && !std::ranges::is_sorted(quantities, std::ranges::greater()))
      fail(key.choices.front().node,
           "search: the values of '{}' neither rise nor fall; list them from lightest to heaviest", key.path);
  }

  // A run for all components; `own` has one for each if any has keys of its own.
  Run make_runs(const std::set<std::string>& owners) const {
    auto run = make_run("");
    for (const auto& component : owners)
      if (!component.empty()) run.own.push_back(make_run(component));
    try {
      const auto all = together(run, origin_.hosts);
      check_addresses(all, origin_.hosts);
      check_queues(all);
    } catch (const std::invalid_argument& error) {
      fail(node_, "run '{}': {}", id_, error.what());
    }
    return run;
  }

  // Of all components (""), or of one: its own keys have precedence over the common ones.
  Run make_run(const std::string& component) const {
    Run run;
    run.id = id_;
    run.where = fmt::format("{}:{}", origin_.file, node_.Mark().line + 1);
    if (!component.empty()) run.component = component;
    const auto holds_for_it = [&](const Said& said) {
      return said.component == component || (said.component.empty() && !is_said_anew(said.key, component));
    };
    for (const bool its_own : {false, true})
      for (std::size_t i = 0; i < dimensions_.size(); ++i)
        if (const auto& said = dimensions_[i].said; said.component.empty() != its_own && holds_for_it(said))
          set(run, dimensions_[i], dimensions_[i].choices[at_[i]]);
    for (std::size_t i = 0; i < dimensions_.size(); ++i) {
      const auto& [path, key, choices, said] = dimensions_[i];
      const auto& choice = choices[at_[i]];
      const bool holds = holds_for_it(said);
      if (&dimensions_[i] == &dimensions_.back()) run.step.among = run.variant;
      if (choices.size() == 1 || (holds && said.key == "transport")) continue;
      if (holds && said.key.starts_with("qos.") && has_no_qos(run.task.transport))
        fail(choice.node,
             "{}: {} has no QoS, so these runs would be the same. Fix: state one value, or use {}", path,
             run.task.transport, other_transports(&transport::Capabilities::qos, true));
      const auto& name = holds ? said.key : path;
      const bool of_others = !holds && !component.empty();
      auto& text = of_others ? run.beside : run.variant;
      if (!of_others) run.varied.emplace_back(name, choice.value);
      text += fmt::format("{}{} {}", text.empty() ? "" : ", ", name, choice.value);
    }
    try {
      complete(run);
      if (origin_.hosts.kind != Hosts::Kind::stated) check_transports(run);
    } catch (const std::invalid_argument& error) {
      fail(node_, "run '{}'{}: {}", id_, component.empty() ? "" : ", " + component, error.what());
    }
    return run;
  }

  // The component sets that key itself, or a key below it, such as realtime.priority.
  bool is_said_anew(const std::string& key, const std::string& component) const {
    return !component.empty() && std::ranges::any_of(dimensions_, [&](const Dimension& other) {
      return other.said.component == component &&
             (other.said.key == key || other.said.key.starts_with(key + "."));
    });
  }

  void set(Run& run, const Dimension& dimension, const Choice& choice) const {
    try {
      check_behind_a_bridge(dimension.path, origin_.hosts);
      if (dimension.key == nullptr)
        set_option(run, dimension.said.key, choice.value);
      else
        dimension.key->set(run, choice.value);
    } catch (const std::invalid_argument& error) {
      fail(choice.node, "{}: {}", dimension.path, error.what());
    }
  }

  Origin& origin_;
  const std::string& id_;
  const YAML::Node& node_;
  const Required& required_;
  std::vector<Dimension> dimensions_;
  std::vector<std::size_t> at_;  // of each dimension, which choice
};

}  // namespace

std::vector<Run> runs_of(Origin& origin, const std::string& id, const YAML::Node& run,
                         const Required& required, Entries entries) {
  return Combinations(origin, id, run, required).of(std::move(entries));
}

}  // namespace ontime::scenario

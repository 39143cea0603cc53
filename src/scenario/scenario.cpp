// SPDX-License-Identifier: Apache-2.0
// A scenario file: its keys are the fields of conditions; here are the file's shape and its errors.
#include "scenario/scenario.hpp"

#include <algorithm>
#include <iterator>
#include <set>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "gate/gate.hpp"
#include "scenario/combinations.hpp"
#include "scenario/complete.hpp"
#include "scenario/document.hpp"
#include "scenario/hosts.hpp"
#include "spelling/spelling.hpp"

namespace ontime::scenario {
namespace {

using conditions::number_of;

constexpr std::size_t most_runs = 100'000;  // with repetitions
constexpr std::size_t most_required = 100;

// The first key of the run that sets the interface itself; "": none.
std::string of_an_interface(const Run& run) {
  for (const auto& setting : settings::table())
    if (setting.of_interface && run.kernel.contains(setting.name))
      return fmt::format("kernel.{}", setting.name);
  return run.isolation.interrupts ? "isolation.interrupts" : "";
}

// Why the run cannot be measured over that wire; "": it can.
std::string why_not_over(const conditions::Wire& wire, const Run& run) {
  if (wire.vlan > 0) {
    const auto name = of_an_interface(run);
    if (name.empty()) return "";
    return fmt::format("{} does not apply to the VLAN interface of wire.vlan: leave out {} or wire.vlan",
                       name, name);
  }
  if (auto why = why_not_by_its_transports(run, wire); !why.empty()) return why;
  if (wire.bits_per_s > 0 && (!run.faults.qdisc.empty() || run.faults.delay.count() > 0))
    return fmt::format(
        "wire.rate and {} both set the queueing discipline of the interface: add wire.vlan, which adds an "
        "interface for the second",
        run.faults.qdisc.empty() ? "link.delay" : "link.qdisc");
  return "";
}

std::string some_of(const std::set<std::string>& ids) {
  constexpr std::size_t enough = 20;
  const auto shown = std::min(ids.size(), enough);
  const auto end = std::next(ids.begin(), static_cast<std::ptrdiff_t>(shown));
  return fmt::format("{}{}", fmt::join(ids.begin(), end, ", "), shown < ids.size() ? " …" : "");
}

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
    once_each(scenario_.file, root);
    for (const auto& entry : root)
      if (const auto key = entry.first.Scalar(); std::ranges::find(file_keys, key) == file_keys.end())
        fail(entry.first, "unknown key '{}'{}", key, meant_in_file(key));
    if (const auto title = root["title"]) scenario_.title = scalar(title, "title");
    if (const auto order = root["order"]) scenario_.interleaved = read_order(order);
    const auto runs = root["runs"], components = root["components"];
    if (!runs || !runs.IsSequence() || runs.size() == 0)
      fail(runs ? runs : root, "runs: a list of runs is needed");
    scenario_.hosts = hosts_of(scenario_.file, root["hosts"], components, root["wire"], scenario_.notices);
    const RunKeys keys(scenario_.file, scenario_.hosts, components.IsDefined(), scenario_.notices);
    Origin origin{scenario_.file, scenario_.hosts, keys, selection_};
    const auto defaults = root["defaults"];
    const auto for_all = defaults ? keys.flat(defaults) : Entries{};
    if (const auto id = for_all.find("id"); id != for_all.end())
      fail(id->second, "id: set it for each run, under runs");
    for (const auto& run : runs) read_run(run, for_all, origin);
    check_baselines();
    if (scenario_.runs.empty()) return std::move(scenario_);  // none is selected
    check_wire();
    if (const auto repeat = root["repeat"]) read_repeat(repeat);
    if (selection_.deploy) deploy();
    if (!selection_.cable.empty()) lay_cable(scenario_.file, selection_.cable, scenario_.hosts);
    return std::move(scenario_);
  }
  const std::set<std::string>& ids() const { return ids_; }  // selected or not

 private:
  template <class... Values>
  [[noreturn]] void fail(const YAML::Node& node, fmt::format_string<Values...> text,
                         Values&&... values) const {
    fail_at(scenario_.file, node.Mark(), text, std::forward<Values>(values)...);
  }

  std::string scalar(const YAML::Node& node, const std::string& key) const {
    return scalar_of(scenario_.file, node, key);
  }

  void deploy() {
    auto& hosts = scenario_.hosts;
    const auto is_here = [](const auto& component) { return component.host.ssh.empty(); };
    if (hosts.controller.ssh.empty() && std::ranges::all_of(hosts.components, is_here))
      throw Error(
          fmt::format("--deploy copies ontime to ssh hosts, and {} has none. Example: hosts: component: "
                      "{{ssh: user@host …}}",
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
      fail(node, "order: '{}' is neither interleaved nor sequential", word);
    return word == "interleaved";
  }

  void read_repeat(const YAML::Node& node) {
    try {
      scenario_.repeat = static_cast<int>(number_of(scalar(node, "repeat"), 1, most_runs));
    } catch (const std::invalid_argument& error) {
      fail(node, "repeat: {}", error.what());
    }
    if (scenario_.size() > most_runs)
      fail(node, "repeat: {} runs, {} times, are {}; a scenario has at most {}", scenario_.runs.size(),
           scenario_.repeat, scenario_.size(), most_runs);
  }

  void read_run(const YAML::Node& node, const Entries& defaults, Origin& origin) {
    if (!node.IsMap()) fail(node, "a run is a map of keys: id, transport, period …");
    auto own = origin.keys.flat(node);
    if (!own.contains("id")) fail(node, "a run needs an id");
    const auto id = scalar(own["id"], "id");
    if (const auto flaw = conditions::flaw_of_id(id); !flaw.empty())
      fail(own["id"], "id: '{}': {}", id, flaw);
    if (!ids_.insert(id).second) fail(own["id"], "there is another run with id '{}'", id);
    own.erase("id");
    const auto stated = own;
    own.insert(defaults.begin(), defaults.end());  // where the run says nothing
    check_sizes(stated, own, origin.keys);
    if (const auto below = own.find("baseline"); below != own.end())
      baselines_.insert_or_assign(id, below->second);
    const auto& only = selection_.only;
    if (!only.empty() && std::ranges::find(only, id) == only.end()) return;
    const auto required = take_require(own, origin.keys);
    for (auto& run : runs_of(origin, id, node, required, std::move(own)))
      scenario_.runs.push_back(std::move(run));
  }

  // The size of workers that the run has none of. The defaults' may be for other runs.
  void check_sizes(const Entries& stated, const Entries& all, const RunKeys& keys) const {
    constexpr std::string_view size = "-bytes";
    for (const auto& [path, node] : stated) {
      auto workers = keys.divided(path).key;
      if (!workers.starts_with("load.") || !workers.ends_with(size)) continue;
      workers.erase(workers.size() - size.size());
      const auto has = [&](const auto& entry) { return keys.divided(entry.first).key == workers; };
      if (std::ranges::none_of(all, has) && !selection_.set.contains(workers))
        fail(node, "{}: no effect without {}, the number of workers", path, workers);
    }
  }

  void check_baseline(const YAML::Node& node) const {
    if (const auto id = scalar(node, "baseline"); !ids_.contains(id))
      fail(node, "baseline: no run has the id '{}'{}; there are: {}", id,
           spelling::suggestion(id, {ids_.begin(), ids_.end()}), some_of(ids_));
  }

  struct Step {  // on the way down from a run to its baselines
    std::string id;
    std::vector<YAML::Node> below;
    std::size_t next = 0;  // of these
  };

  // `report --layers` subtracts a run's baseline, and that one's in turn: a circle has no lowest layer.
  void check_baselines() const {
    std::set<std::string> ending, on_the_way;  // from the former on it is known that the baselines end
    std::vector<Step> way;
    const auto enter = [&](const std::string& id) {
      const auto found = baselines_.find(id);
      if (found == baselines_.end() || ending.contains(id)) return;
      const auto& node = found->second;
      way.push_back(
          {id, node.IsSequence() ? std::vector<YAML::Node>(node.begin(), node.end()) : std::vector{node}});
      on_the_way.insert(id);
    };
    for (const auto& [first, node] : baselines_)
      for (enter(first); !way.empty();) {
        auto& step = way.back();
        if (step.next == step.below.size()) {
          ending.insert(step.id);
          on_the_way.erase(step.id);
          way.pop_back();
          continue;
        }
        const auto& below = step.below[step.next++];
        check_baseline(below);
        if (on_the_way.contains(below.Scalar())) fail_with_circle(way, below.Scalar());
        enter(below.Scalar());
      }
  }

  [[noreturn]] void fail_with_circle(const std::vector<Step>& way, const std::string& id) const {
    const auto first = std::ranges::find(way, id, &Step::id);
    std::string circle;
    for (auto step = first; step != way.end(); ++step) circle += step->id + " → ";
    fail(first->below[first->next - 1], "baseline: the baselines form a circle: {}{}", circle, id);
  }

  Required take_require(Entries& entries, const RunKeys& keys) const {
    Required required;
    for (auto entry = entries.begin(); entry != entries.end();) {
      const auto [component, key] = keys.divided(entry->first);
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

  // A list that does not multiply: all gates apply.
  std::vector<std::string> read_require(const YAML::Node& node) const {
    std::vector<std::string> gates;
    const auto read = [&](const YAML::Node& gate) {
      gates.push_back(scalar(gate, "require"));
      try {
        gate::parse(gates.back(), gate::Use::require);
      } catch (const gate::Error& error) {
        fail(gate, "require: '{}', {}", gates.back(), error.what());
      }
    };
    if (!node.IsSequence())
      read(node);
    else
      for (const auto& gate : node) read(gate);
    if (gates.size() > most_required) fail(node, "require: at most {} gates per run", most_required);
    return gates;
  }

  const Selection& selection_;
  Scenario scenario_;
  std::set<std::string> ids_;
  std::map<std::string, YAML::Node> baselines_;  // of runs that have one, by id, selected or not
};

// `which_have`: "demo.yaml has".
void check_only(const Selection& selection, const std::set<std::string>& ids, const std::string& which_have) {
  for (const auto& id : selection.only)
    if (!ids.contains(id))
      throw Error(fmt::format("{} no run '{}'{}; there are: {}", which_have, id,
                              spelling::suggestion(id, {ids.begin(), ids.end()}), some_of(ids)));
}

}  // namespace

Run Scenario::at(std::size_t number) const {
  const auto times = static_cast<std::size_t>(repeat);
  auto run = runs.at(interleaved ? number % runs.size() : number / times);
  run.repetition = 1 + static_cast<int>(interleaved ? number / runs.size() : number % times);
  return run;
}

std::chrono::duration<double> time_of(const Run& run) {
  // Start, matching and the account, as seen with three transports; and until stress runs.
  constexpr std::chrono::duration<double> beside(0.5), stress(3.5);
  const auto has_stress = [](const Run& one) {
    return one.controller_load.any() || one.component_load.any() || one.traffic.any();
  };
  const auto warm_up = [](const Run& one) {
    return static_cast<double>(one.task.client.warm_up) * roundtrip::warm_up_pause(one.task.client);
  };
  std::chrono::duration<double> longest = warm_up(run);  // all warm up before any begins
  for (const auto& own : run.own) longest = std::max<std::chrono::duration<double>>(longest, warm_up(own));
  const bool waits = has_stress(run) || std::ranges::any_of(run.own, has_stress);
  return beside + (waits ? stress : stress.zero()) + run.task.client.duration + longest;
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

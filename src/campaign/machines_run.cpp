// SPDX-License-Identifier: Apache-2.0
// What the machines do for what is measured at one time: settings, load, links, traffic and traces.
#include <algorithm>
#include <map>
#include <string>
#include <utility>

#include <fmt/format.h>

#include "campaign/machines.hpp"
#include "campaign/traffic.hpp"
#include "keeper/keeper.hpp"
#include "settings/settings.hpp"

namespace ontime::campaign {
namespace {

using nlohmann::json;

// Names for the keepers: of what is made for a host, and of what is made at the controller for one component.
std::string name_of(const std::string& host) {
  auto name = host;
  std::replace(name.begin(), name.end(), '_', '-');
  return name;
}

std::string name_at_controller(const std::string& component) {
  return fmt::format("{}-{}", controller, name_of(component));
}

// What tells an interface from others.
std::vector<std::string> interface_of(const Host& host) {
  auto words = way_to(host);
  words.insert(words.end(), host.command_prefix.begin(), host.command_prefix.end());
  words.push_back(host.interface);
  return words;
}

// The answer to "check", with the host and how it gets root.
std::string lack_of_link(const std::string& name, const Host& host, const json& answer) {
  auto what = fmt::format("on the {}, {}", name, answer.at("error").get<std::string>());
  if (!answer.contains("root_by")) return what;
  std::string by = answer.at("root_by");
  if (by.empty()) by = host.ssh.empty() ? as_root() : by_root(host.ssh) + ", or host-prefix: [sudo, -n]";
  return what + ". Fix: " + by;
}

bool all_by_ip(const Together& runs) {
  return std::ranges::none_of(runs, [](const Run& run) { return is_below_ip(run.task.transport); });
}

}  // namespace

void add_counts(record::Link& to, const record::Link& of_keeper) {
  if (of_keeper.gone) to.gone = of_keeper.gone;
  if (of_keeper.faults) to.faults = of_keeper.faults;
  if (of_keeper.etf) to.etf = of_keeper.etf;
  if (of_keeper.beside_traffic) to.beside_traffic = of_keeper.beside_traffic;
}

json Machines::link_of(const std::string& host) const {
  const auto& where = hosts_.at(host);
  const auto peer = host == controller ? without_port(hosts_.components.front().host.address) : "";
  return {{"interface", where.interface},
          {"network_namespace", network_namespace(where).value_or("")},
          {"peer", peer},
          {"address", without_port(where.address)}};
}

std::map<std::string, json> Machines::look(const settings::Wishes& wishes) const {
  std::map<std::string, json> looked;
  for (const auto& [reach, machine] : machines_)
    for (const auto& host : machine.hosts)
      if (network_namespace(hosts_.at(host)))
        looked[host] = ask(machine, "look", "looked", {{"link", link_of(host)}, {"wishes", wishes}});
  return looked;
}

std::vector<std::string> Machines::tune(const Together& runs) {
  const auto& run = runs.front();  // settings of machines are the same for all runs
  std::vector<std::string> shared;
  if (run.kernel.empty() && !run.isolation.any()) return shared;
  for (const auto& one : runs)
    if (const auto text = settings::warning(one.kernel, application_priority(one));
        !text.empty() && warned_.insert(text).second)
      observer_.note("kernel: " + text);
  tuned_ = true;
  // Another command prefix may run traffic outside our control groups, as in a container.
  const bool needs_namespace =
      !run.kernel.empty() || run.isolation.interrupts || (run.isolation.limits() && !ports_of(runs).empty());
  for (auto& [reach, machine] : machines_)
    for (const auto& host : machine.hosts) {
      if (needs_namespace && !network_namespace(hosts_.at(host)))
        throw Error(
            2,
            "kernel.*, isolation.interrupts, and isolation.load-* with traffic need the command prefix "
            "[ip, netns, exec, NAME] or none");
      const auto link = link_of(host);
      if (run.isolation.any())
        if (auto text = isolate(host, run, link); !text.empty()) shared.push_back(std::move(text));
      if (run.kernel.empty()) continue;
      const auto tuned =
          ask(machine, "tune", "tuned", {{"host", host}, {"link", link}, {"wishes", run.kernel}});
      if (tuned.contains("error")) {
        const auto text = fmt::format("on the {}, {}", host, tuned.at("error").get<std::string>());
        if (tuned.contains("refused")) throw Refused(text, tuned.at("refused"));
        throw Error(3, text);
      }
      if (const auto note = tuned.value("note", ""); !note.empty()) {
        const auto text = fmt::format("on the {}, kernel.{}", host, note);
        if (warned_.insert(text).second) observer_.note(text);
      }
    }
  return shared;
}

std::string Machines::isolate(const std::string& host, const Run& run, const json& link) {
  const std::string stay = have(host, "isolate", "isolated",
                                {{"host", host}, {"link", link}, {"wish", keeper::to_json(run.isolation)}})
                               .at("stay");
  if (stay.empty()) return "";
  auto text =
      fmt::format("isolation: on the {}, threads with an affinity of their own may still run on CPUs {}: {}",
                  host, run.isolation.cpus, stay);
  if (warned_.insert(host + run.isolation.cpus).second) observer_.note(text);
  return text;
}

void Machines::keep(const std::string& host, pid_t process) const {
  have(host, "keep", "kept", {{"pid", process}});
}

void Machines::restore() {
  if (!std::exchange(tuned_, false)) return;
  give_back("restore", "restored");
}

void Machines::check(const Run& run) {
  const auto fail = [&](const std::string& what) {
    throw Error(3, fmt::format("{}: run '{}': {}", run.where, run.id, what));
  };
  if (hosts_.kind == Hosts::Kind::loopback)
    fail(
        "link.*: loopback cannot have link faults, because other programs use it too. Fix: hosts: "
        "namespaces, as root");
  const auto check_host = [&](const Host& host) {
    if (host.interface.empty()) fail("link.*: each host needs its `interface`");
    if (!network_namespace(host))
      fail("link.*: the command prefix must be [ip, netns, exec, NAME] or none, to restore the link");
  };
  for (const auto& component : hosts_.components) check_host(component.host);
  check_host(hosts_.controller);
  if (run.task.config.launch_ns > 0 && has_ports())
    fail("launch-time: the controller's bridge has one interface for all components. Fix: use one component");
  for (auto& [reach, machine] : machines_)
    if (const auto answer = ask(machine, "check", "checked", {{"faults", keeper::to_json(run.faults)}});
        answer.contains("error"))
      fail(lack_of_link(machine.hosts.front(), machine.where, answer));
}

bool Machines::has_ports() const {
  return std::ranges::any_of(hosts_.components,
                             [](const auto& component) { return !component.host.port.empty(); });
}

// The ends at each component and at the controller. With a bridge, each component's link has its own end at
// its port; messages are marked and counted at the controller's interface. Components that share an interface
// share an end.
std::vector<Machines::LinkEnd> Machines::ends_of_links(const Together& runs) const {
  std::map<std::vector<std::string>, Together> sharing;
  for (const auto& run : runs) sharing[interface_of(hosts_.at(run.component))].push_back(run);
  std::vector<LinkEnd> ends;
  for (const auto& run : runs) {
    const auto& host = hosts_.at(run.component);
    if (const auto& all = sharing.at(interface_of(host)); all.front().component == run.component)
      ends.push_back({run.component, name_of(run.component), host.interface, run.faults, run.cut,
                      run.component, ports_of(all), all_by_ip(all)});
    if (!host.port.empty())
      ends.push_back({controller, name_at_controller(run.component), host.port, run.faults.without_marks(),
                      run.cut, run.component});
  }
  const auto& common = runs.front();
  LinkEnd whole{controller,     controller,     hosts_.controller.interface, common.faults, common.cut, "",
                ports_of(runs), all_by_ip(runs)};
  if (has_ports()) {
    whole.faults = common.faults.marks();
    whole.cut = {};
  }
  ends.push_back(std::move(whole));
  return ends;
}

// For an end with faults, or with traffic from which messages must be counted apart.
void Machines::link(const LinkEnd& end) {
  const auto netns = network_namespace(hosts_.at(end.host));
  const bool counts = end.by_ip && !end.traffic_ports.empty();
  if (!end.faults.any() && (!counts || end.interface.empty() || !netns)) return;
  const auto answer = ask(machine_of(end.host), "link", "linked",
                          {{"host", end.name},
                           {"network_namespace", netns.value_or("")},
                           {"interface", end.interface},
                           {"faults", keeper::to_json(end.faults)},
                           {"traffic_ports", end.traffic_ports},
                           {"by_ip", end.by_ip}});
  // Without faults the run goes on: the record says that the link is not verified.
  if (end.faults.any() && answer.contains("error")) throw Error(3, answer.at("error"));
}

void Machines::cut(WasCut told) {
  was_cut_ = std::move(told);
  for (const auto& end : links_) {
    if (!end.cut) continue;
    const auto after = std::chrono::duration_cast<std::chrono::milliseconds>(end.cut->at);
    ask(machine_of(end.host), "cut", "cutting",
        {{"host", end.name}, {"after_ms", after.count()}, {"for_ms", end.cut->length.count()}});
  }
}

std::vector<std::string> Machines::load(const Together& runs) {
  loaded_ = true;
  std::vector<std::string> scaled;
  const auto load_on = [&](const std::string& host, const background::Workers& workers) {
    if (!workers.any()) return;
    const auto loaded = have(host, "load", "loaded", {{"host", host}, {"load", keeper::to_json(workers)}});
    const std::string text = loaded.at("scaled");
    if (text.empty()) return;
    scaled.push_back(fmt::format("on the {}, {}", host, text));
    if (warned_.insert(scaled.back()).second) observer_.note(scaled.back());
  };
  load_on(controller, runs.front().controller_load);
  if (hosts_.kind == Hosts::Kind::alone) return scaled;
  for (const auto& run : runs) load_on(run.component, run.component_load);
  for (const auto& run : runs)
    for (const std::string& host : {run.component, std::string(controller)})
      for (const auto& way : ways_of(run.traffic))
        have(host, "traffic", "flowing",
             {{"host", host == controller ? name_at_controller(run.component) : name_of(host)},
              {"way", way},
              {"stream", stream_of(run, way, host, hosts_)}});
  // Only then: iperf3 begins with a datagram that it does not send again.
  links_ = ends_of_links(runs);
  for (const auto& end : links_) link(end);
  return scaled;
}

void Machines::trace(WindowCame came) {
  window_came_ = std::move(came);
  std::string refused;
  bool any = false;
  for (auto& [reach, machine] : machines_) {
    const auto& host = machine.hosts.front();
    const auto& traced = traced_[host] = record::read<record::Traced>(ask(machine, "trace", "tracing"));
    if (!traced.error.empty())
      refused = fmt::format("explain: on the {}'s machine: {}", host, traced.error);
    else
      any = true;
  }
  if (!any) throw Error(3, refused);
  if (!refused.empty()) observer_.note(refused);
}

std::vector<std::string> Machines::traced(const std::string& component) const {
  std::vector<std::string> hosts = {controller};
  if (hosts_.kind != Hosts::Kind::alone)
    if (const auto& first = machine_of(component).hosts.front(); first != controller) hosts.push_back(first);
  std::erase_if(hosts, [this](const auto& host) { return !traced_.at(host).error.empty(); });
  return hosts;
}

record::ByName<record::Traced> Machines::how_traced(const std::string& component) const {
  record::ByName<record::Traced> all = {{controller, traced_.at(controller)}};
  if (hosts_.kind != Hosts::Kind::alone)
    if (const auto& first = machine_of(component).hosts.front(); first != controller)
      all["component"] = traced_.at(first);
  return all;
}

void Machines::cut_out(const std::string& host, const std::vector<trace::Span>& spans) {
  auto asked = json::array();
  for (const auto& span : spans) asked.push_back({span.message, span.from_ns, span.to_ns});
  machine_of(host).keeper->order("cut-out", {{"spans", std::move(asked)}});
}

void Machines::unload() {
  if (!std::exchange(loaded_, false)) return;
  was_cut_ = nullptr;
  links_.clear();
  window_came_ = nullptr;
  give_back("unload", "unloaded");
}

void Machines::begin() {
  for (auto& [reach, machine] : machines_) ask(machine, "begin", "begun");
}

Machines::Account Machines::end() {
  Account account;
  std::map<std::string, record::Link> links;
  auto traffic = json::object();
  for (auto& [reach, machine] : machines_) {
    auto read = json::object();
    for (const auto& host : machine.hosts)
      if (network_namespace(hosts_.at(host))) read[host] = link_of(host);
    const auto ended = ask(machine, "end", "ended", {{"links", std::move(read)}});
    for (const auto& host : machine.hosts) {
      account.conditions[host] = record::read<record::Activity>(ended.at("conditions"));
      account.hosts[host] = record::read<record::Host>(ended.at("hosts").value(host, json()));
      account.hosts[host].machine = record::read<record::Machine>(ended.at("machine"));
    }
    for (const auto& [name, link] : ended.at("links").items()) links[name] = record::read<record::Link>(link);
    traffic.update(ended.at("traffic"));
    account.others[machine.hosts.front()] = ended.at("others");
  }
  account_of(links, traffic, account);
  return account;
}

// Assigns what the keepers report of link ends and traffic, by name, to each component.
void Machines::account_of(const std::map<std::string, record::Link>& links, const json& traffic,
                          Account& account) const {
  if (hosts_.kind == Hosts::Kind::alone) return;
  for (const auto& [component, host] : hosts_.components) {
    const auto first = std::ranges::find_if(hosts_.components, [&, &own = host](const auto& other) {
      return interface_of(other.host) == interface_of(own);
    });
    auto& of_component = account.links[component];
    for (const auto& [role, name] : {std::pair(controller, std::string(controller)),
                                     {controller, name_at_controller(component)},
                                     {"component", name_of(first->name)}})
      if (const auto link = links.find(name); link != links.end())
        add_counts(of_component[role], link->second);
    for (const auto& end : links_)
      if (!end.traffic_ports.empty() && (end.component.empty() || end.component == first->name))
        account.with_traffic[component].insert(end.component.empty() ? controller : "component");
    account.traffic[component] = {{controller, traffic.value(name_at_controller(component), json::object())},
                                  {"component", traffic.value(name_of(component), json::object())}};
  }
}

}  // namespace ontime::campaign

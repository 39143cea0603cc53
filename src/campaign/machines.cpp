// SPDX-License-Identifier: Apache-2.0
#include "campaign/machines.hpp"

#include <algorithm>
#include <exception>
#include <map>
#include <string>
#include <tuple>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "campaign/deploy.hpp"
#include "campaign/kernel.hpp"
#include "campaign/keys.hpp"
#include "campaign/traffic.hpp"
#include "keeper/keeper.hpp"
#include "machine/machine.hpp"

namespace ontime::campaign {
namespace {

using nlohmann::json;

constexpr const char* controller = "controller";

// Where an end lives, by the name that `ip netns` has for it; nothing: somewhere else.
std::optional<std::string> network_namespace(const Host& host) {
  const auto& place = host.place;
  if (place.empty()) return "";
  const std::vector<std::string> exec = {"ip", "netns", "exec"};
  if (place.size() != exec.size() + 1 || !std::equal(exec.begin(), exec.end(), place.begin())) return {};
  return place.back();
}

Host host_of(const json& from) {
  return {{}, {}, from.at("place"), {}, from.at("interface"), from.at("address")};
}

json cable_of(const Hosts& hosts) {
  if (hosts.controller.interface.empty()) return nullptr;
  return {{"controller", hosts.controller.interface}, {"component", hosts.components.front().host.interface}};
}

std::string program_of(const Host& host) {
  if (!host.program.empty()) return host.program;
  return host.ssh.empty() ? orders::this_program() : "ontime";
}

std::vector<std::string> keeper_command(const Host& host) {
  auto words = host.reach;
  words.insert(words.end(), {program_of(host), "keeper"});
  return words;
}

std::vector<std::string> agent_command(const Host& host) {
  auto words = host.reach;
  words.insert(words.end(), host.place.begin(), host.place.end());
  words.insert(words.end(), {program_of(host), "agent"});
  return words;
}

std::vector<std::string> names_of(const std::vector<Hosts::Component>& components) {
  std::vector<std::string> names;
  for (const auto& component : components) names.push_back(component.name);
  return names;
}

// How a machine is reached, by which it is told from others.
std::vector<std::string> way_to(const Host& host) {
  auto words = host.reach;
  words.insert(words.begin(), host.ssh);
  return words;
}

}  // namespace

Machines::Machines(orders::Coordinator& coordinator, Observer& observer)
    : coordinator_(coordinator), observer_(observer) {}

void Machines::prepare(const Hosts& stated) {
  machines_.clear();
  hosts_ = stated;
  if (hosts_.kind == Hosts::Kind::namespaces && cable_of(hosts_).is_null() &&
      !machine::may_join_namespaces()) {
    if (hosts_.components.size() > 1)
      throw Error(3,
                  "components: no permission to make a network namespace for each: run as root (sudo ontime "
                  "run …), or state where they are");
    observer_.note(
        "no permission to make network namespaces: the two ends are two processes on loopback instead. "
        "To have two \"machines\", run as root: sudo ontime run …");
    hosts_.kind = Hosts::Kind::loopback;
  }
  if (hosts_.kind == Hosts::Kind::loopback)
    hosts_.controller = hosts_.components.front().host = {{}, {}, {}, {}, "lo", "127.0.0.1"};
  add(controller, hosts_.controller);
  if (hosts_.kind != Hosts::Kind::alone)
    for (const auto& [name, host] : hosts_.components) add(name, host);
  for (auto& [reach, machine] : machines_) {
    const auto opened = ask(machine, "open", "opened");
    machine.description = opened.at("machine");
    if (machine.ssh && hosts_.deploy)
      for (const auto& host : machine.hosts) hosts_.at(host).program = opened.at("program");
    tell(opened.at("notes"));
  }
  tell_of_two_ways();
  if (hosts_.kind != Hosts::Kind::namespaces) return;
  const auto joined = ask(machines_.begin()->second, "join", "joined",
                          {{"components", names_of(hosts_.components)}, {"cable", cable_of(hosts_)}});
  for (const auto& [name, host] : joined.at("hosts").items()) hosts_.at(name) = host_of(host);
}

void Machines::add(const std::string& host, const Host& where) {
  auto& machine = machines_[way_to(where)];
  machine.hosts.push_back(host);
  if (machine.keeper) return;
  const auto name = "the keeper of the " + host + "'s machine";
  auto command = keeper_command(where);
  orders::Between between;
  if (!where.ssh.empty()) {
    machine.ssh = std::make_unique<Ssh>(where.ssh);
    command = machine.ssh->first(command);
    between = machine.ssh->between(program_of(where));
    if (hosts_.deploy) std::tie(command, between) = deployment(*machine.ssh, where.reach, *hosts_.deploy);
  }
  machine.keeper = std::make_unique<Hand>(coordinator_, name, command, "", std::move(between));
  machine.keeper->on("window", [this, host](const orders::Frame& frame) {
    if (window_came_) window_came_(host, frame.message.at("window"));
  });
  // Both ends' are cut; when, is said by the clock of the controller, as of everything else.
  machine.keeper->on("cut", [this, is_controllers = host == controller](const orders::Frame& frame) {
    if (is_controllers && frame.message.at("host") == controller && when_cut_)
      when_cut_(frame.message.at("at_ns"));
  });
}

// By its ways alone a machine cannot be told from another: what it says of itself can.
void Machines::tell_of_two_ways() {
  std::map<std::string, std::string> first_host;  // by boot
  for (const auto& [reach, machine] : machines_) {
    const auto boot = machine.description.value("boot_id", json());
    if (!boot.is_string()) continue;
    const auto [first, is_new] = first_host.emplace(boot.get<std::string>(), machine.hosts.front());
    if (!is_new)
      observer_.note(fmt::format(
          "the {} and the {} are on one machine, which is reached in two ways: each way has a keeper of its "
          "own, and what is to be set of the machine is set by both. To have one, state the same way for "
          "both.",
          first->second, machine.hosts.front()));
  }
}

std::unique_ptr<Machines::Hand> Machines::start_agent(const std::string& host,
                                                      const std::string& whom) const {
  const auto& where = hosts_.at(host);
  const auto name = fmt::format("the agent of the {}{}", host, whom);
  auto command = agent_command(where);
  orders::Between between;
  if (const auto& ssh = machine_of(host).ssh) {
    command = ssh->another(command);
    between = ssh->between(program_of(where));
  }
  return std::make_unique<Hand>(coordinator_, name, command, agent::sample_layout(), std::move(between));
}

const Machines::Machine& Machines::machine_of(const std::string& host) const {
  const auto found = std::find_if(machines_.begin(), machines_.end(), [&](const auto& entry) {
    const auto& hosts = entry.second.hosts;
    return std::find(hosts.begin(), hosts.end(), host) != hosts.end();
  });
  return found->second;
}

// Who serves is ready before who asks.
std::vector<std::string> Machines::from_who_serves() const {
  auto names = names_of(hosts_.components);
  names.emplace_back(controller);
  return names;
}

bool Machines::lost() const {
  return std::any_of(machines_.begin(), machines_.end(),
                     [](const auto& entry) { return entry.second.keeper->lost(); });
}

void Machines::warn(const Run& run) {
  const auto text = settings::warning(run.kernel, application_priority(run));
  if (!text.empty() && warned_.insert(text).second) observer_.note("kernel: " + text);
}

void Machines::tune(const Run& run) {
  if (run.kernel.empty() && !run.isolation.any()) return;
  warn(run);
  tuned_ = true;
  for (auto& [reach, machine] : machines_)
    for (const auto& host : machine.hosts) {
      const bool asks = host == controller;
      const auto& where = hosts_.at(host);
      const auto netns = network_namespace(where);
      if (!netns)
        throw Error(2,
                    "kernel.*, isolation.*: a place other than [ip, netns, exec, NAME] is not where a keeper "
                    "can look");
      const json link = {{"interface", where.interface},
                         {"network_namespace", *netns},
                         {"peer", asks ? without_port(hosts_.components.front().host.address) : ""},
                         {"address", without_port(where.address)}};
      if (run.isolation.any()) isolate(machine, host, run, link);
      if (run.kernel.empty()) continue;
      const auto tuned =
          ask(machine, "tune", "tuned", {{"host", host}, {"link", link}, {"wishes", run.kernel}});
      if (tuned.contains("error"))
        throw Error(3, fmt::format("on the {}, {}", host, tuned.at("error").get<std::string>()));
    }
}

void Machines::isolate(const Machine& machine, const std::string& host, const Run& run, const json& link) {
  const auto isolated = ask(machine, "isolate", "isolated",
                            {{"host", host}, {"link", link}, {"wish", keeper::to_json(run.isolation)}});
  if (isolated.contains("error"))
    throw Error(3, fmt::format("on the {}, {}", host, isolated.at("error").get<std::string>()));
  const auto stay = isolated.at("stay").get<std::vector<std::string>>();
  if (stay.empty() || !warned_.insert(host + run.isolation.cpus).second) return;
  observer_.note(
      fmt::format("isolation: on the {}, {} threads may run on CPUs {} all the same: they were given "
                  "CPUs of their own: {}",
                  host, stay.size(), run.isolation.cpus, fmt::join(stay, ", ")));
}

void Machines::keep(const std::string& host, pid_t process) const {
  const auto kept = ask(machine_of(host), "keep", "kept", {{"pid", process}});
  if (kept.contains("error"))
    throw Error(3, fmt::format("on the {}, {}", host, kept.at("error").get<std::string>()));
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
        "link.*: on loopback there is no link whose faults would be these two ends' alone: say hosts: "
        "namespaces, "
        "as root");
  for (const auto& name : from_who_serves()) {
    const auto& host = hosts_.at(name);
    if (host.interface.empty()) fail("link.*: which link? Each of the hosts needs its interface");
    if (!network_namespace(host))
      fail("link.*: a place other than [ip, netns, exec, NAME] could not be given back as it was");
  }
  for (auto& [reach, machine] : machines_)
    if (const auto answer = ask(machine, "check", "checked", {{"faults", keeper::to_json(run.faults)}});
        answer.contains("error"))
      fail(answer.at("error"));
}

// With faults, or with traffic, beside which the messages are to be counted.
void Machines::link(const std::string& host, const Run& run) {
  const auto& where = hosts_.at(host);
  const auto netns = network_namespace(where);
  const bool can_count = !is_below_ip(run.task.transport);
  if (!run.faults.any() && (!can_count || ports_of(run.traffic).empty() || where.interface.empty() || !netns))
    return;
  const auto answer = ask(machine_of(host), "link", "linked",
                          {{"host", host},
                           {"network_namespace", netns.value_or("")},
                           {"interface", where.interface},
                           {"faults", keeper::to_json(run.faults)},
                           {"not_counted", can_count ? json(ports_of(run.traffic)) : json()}});
  // Without faults it can be done without: the record says that nothing is proved then.
  if (run.faults.any() && answer.contains("error")) throw Error(3, answer.at("error"));
}

void Machines::cut(const Cut& cut, std::function<void(std::int64_t at_ns)> told) {
  when_cut_ = std::move(told);
  const auto after = std::chrono::duration_cast<std::chrono::milliseconds>(cut.at);
  for (const auto& host : from_who_serves())
    ask(machine_of(host), "cut", "cutting",
        {{"host", host}, {"after_ms", after.count()}, {"for_ms", cut.length.count()}});
}

void Machines::load(const Run& run) {
  loaded_ = true;
  for (auto& [reach, machine] : machines_)
    for (const auto& host : machine.hosts) {
      const auto& workers = host == controller ? run.controller_load : run.component_load;
      if (workers.any()) ask(machine, "load", "loaded", {{"host", host}, {"load", keeper::to_json(workers)}});
    }
  if (hosts_.kind == Hosts::Kind::alone) return;
  for (const auto& host : from_who_serves())
    for (const auto& way : ways_of(run.traffic))
      ask(machine_of(host), "traffic", "flowing",
          {{"host", host},
           {"way", way},
           {"stream", keeper::to_json(stream_of(run.traffic, way, host, hosts_))}});
  // Only then: iperf3 begins with a datagram that it does not send again.
  for (const auto& host : from_who_serves()) link(host, run);
}

json Machines::trace(WindowCame came) {
  window_came_ = std::move(came);
  auto answers = json::object();
  std::string refused;
  traced_.clear();
  for (auto& [reach, machine] : machines_) {
    const auto& host = machine.hosts.front();
    auto answer = ask(machine, "trace", "tracing");
    answer.erase("event");
    if (answer.contains("error"))
      refused = fmt::format("explain: on the {}'s machine: {}", host, answer.at("error").get<std::string>());
    else
      traced_.push_back(host);
    answers[host] = std::move(answer);
  }
  if (traced_.empty()) throw Error(3, refused);
  if (!refused.empty()) observer_.note(refused);
  return answers;
}

void Machines::cut_out(const std::string& host, const std::vector<trace::Span>& spans) {
  auto asked = json::array();
  for (const auto& span : spans) asked.push_back({span.message, span.from_ns, span.to_ns});
  machine_of(host).keeper->order("cut-out", {{"spans", std::move(asked)}});
}

void Machines::unload() {
  if (!std::exchange(loaded_, false)) return;
  when_cut_ = nullptr;
  window_came_ = nullptr;
  traced_.clear();
  give_back("unload", "unloaded");
}

void Machines::begin() {
  for (auto& [reach, machine] : machines_) ask(machine, "begin", "begun");
}

Machines::Account Machines::end() {
  Account account;
  for (auto& [reach, machine] : machines_) {
    const auto ended = ask(machine, "end", "ended");
    for (const auto& host : machine.hosts) {
      account.conditions[host] = ended.at("conditions");
      account.load_running[host] = ended.at("load_running").value(host, json());
      account.links[host] = ended.at("links").value(host, json());
      account.traffic[host] = ended.at("traffic").value(host, json::object());
      account.kernel[host] = ended.at("kernel").value(host, json());
      account.isolation[host] = ended.at("isolation").value(host, json());
      account.machine[host] = ended.at("machine");
    }
  }
  return account;
}

void Machines::close() { give_back("close", "closed"); }

// By all, whatever becomes of one.
void Machines::give_back(const char* order, const char* answer) {
  std::exception_ptr first;
  for (auto& [reach, machine] : machines_) try {
      if (!machine.keeper->lost()) tell(ask(machine, order, answer).at("notes"));
    } catch (...) {
      if (!first) first = std::current_exception();
    }
  if (first) std::rethrow_exception(first);
}

void Machines::tell(const json& notes) {
  for (const auto& note : notes) observer_.note(note);
}

json Machines::ask(const Machine& machine, const char* order, const char* answer, json body) const {
  machine.keeper->order(order, std::move(body));
  return coordinator_.await(*machine.keeper, answer, patience, 1);
}

}  // namespace ontime::campaign

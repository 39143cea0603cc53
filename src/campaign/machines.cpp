// SPDX-License-Identifier: Apache-2.0
#include "campaign/machines.hpp"

#include <algorithm>
#include <cstdlib>
#include <exception>
#include <string>
#include <tuple>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sys/utsname.h>
#include <unistd.h>

#include "agent/agent.hpp"
#include "campaign/deploy.hpp"
#include "keeper/keeper.hpp"
#include "machine/machine.hpp"
#include "process/process.hpp"
#include "realtime/privileges.hpp"
#include "table/table.hpp"

namespace ontime::campaign {
namespace {

using nlohmann::json;

using Clock = std::chrono::steady_clock;

constexpr std::chrono::seconds silent_wait{5};

Host host_of(const json& from) {
  return {{}, {}, from.at("place"), {}, from.at("interface"), from.at("address"), from.at("port")};
}

json cable_of(const Hosts& hosts) {
  if (hosts.controller.interface.empty()) return nullptr;
  return {{"controller", hosts.controller.interface}, {"component", hosts.components.front().host.interface}};
}

std::string program_of(const Host& host) {
  if (!host.program.empty()) return host.program;
  return host.ssh.empty() ? orders::this_program() : "ontime";
}

std::vector<std::string> prefix_of(const Host& host, const std::vector<std::string>& place) {
  auto words = host.host_prefix;
  words.insert(words.end(), place.begin(), place.end());
  return words;
}

std::vector<std::string> command_of(const Host& host, const std::vector<std::string>& place,
                                    const char* worker) {
  auto words = prefix_of(host, place);
  words.insert(words.end(), {program_of(host), worker});
  return words;
}

orders::Between between_of(const Host& host, const Ssh* ssh, const std::vector<std::string>& prefix,
                           const std::vector<std::string>& command) {
  if (ssh != nullptr) return ssh->between(program_of(host), prefix, table::shell_line(command));
  return {{}, [prefix](int code, const auto&) { return reason_of_prefix("", prefix, code); }};
}

// Whom the keeper names to another ontime that wants the machine: here this process, there its command line.
json holder_of(const Host& where) {
  const auto command = fmt::format("{}", fmt::join(process::command_line(), " "));
  if (where.ssh.empty()) return {{"pid", getpid()}, {"command", command}};
  const char* user = std::getenv("SUDO_USER");      // NOLINT(concurrency-mt-unsafe): nothing sets it
  if (user == nullptr) user = std::getenv("USER");  // NOLINT(concurrency-mt-unsafe): nothing sets it
  utsname here{};
  uname(&here);
  return {{"command", fmt::format("{}@{}: {}", user == nullptr ? "" : user, here.nodename, command)}};
}

// Collects the problems of all machines, to report them together.
class Problems {
 public:
  void of(const std::function<void()>& step) {
    try {
      step();
    } catch (const Error& error) {
      texts_.emplace_back(error.what());
      exit_ = std::max(exit_, error.exit);
    }
  }
  void tell() const {
    if (texts_.size() == 1) throw Error(exit_, texts_.front());
    if (!texts_.empty())
      throw Error(exit_, fmt::format("{} problems (nothing was changed):\n{}", texts_.size(),
                                     fmt::join(texts_, "\n")));
  }

 private:
  std::vector<std::string> texts_;
  int exit_ = 0;
};

}  // namespace

std::string as_root(bool with_command) {
  if (auto in_container = realtime::how_to_be_root_in_container(realtime::privileges());
      !in_container.empty())
    return in_container;
  const auto command = table::shell_line(process::command_line());
  return with_command && table::printable(command) == command ? "sudo " + command : "run it as root";
}

std::optional<std::string> network_namespace(const Host& host) {
  const auto& place = host.command_prefix;
  if (place.empty()) return "";
  const std::vector<std::string> exec = {"ip", "netns", "exec"};
  if (place.size() != exec.size() + 1 || !std::equal(exec.begin(), exec.end(), place.begin())) return {};
  return place.back();
}

std::vector<std::string> way_to(const Host& host) {
  auto words = host.host_prefix;
  words.insert(words.begin(), host.ssh);
  return words;
}

Machines::Machines(orders::Coordinator& coordinator, Observer& observer)
    : coordinator_(coordinator), observer_(observer) {}

Machines::~Machines() {
  coordinator_.tolerate_one_more();
  leave_all();
}

void Machines::leave_all() noexcept {
  for (auto& [way, machine] : machines_)
    if (machine.keeper && !leave(machine)) give_back_anew(machine);
}

Hosts::Kind Machines::kind_here(const Hosts& stated) {
  const bool lacks_permission =
      stated.kind == Hosts::Kind::namespaces && cable_of(stated).is_null() && !machine::may_join_namespaces();
  return lacks_permission ? Hosts::Kind::loopback : stated.kind;
}

void Machines::prepare(const Hosts& stated, const Transports& transports) {
  observer_.does("looking at the machines");
  leave_all();
  machines_.clear();
  hosts_ = stated;
  lacks_namespaces_ = kind_here(stated) != stated.kind;
  if (lacks_namespaces_) {
    if (hosts_.components.size() > 1)
      throw Error(3,
                  "components: no permission to create a network namespace for each. Fix: state their hosts, "
                  "or " +
                      as_root());
    if (hosts_.wire.any())
      throw Error(3, "wire: no permission to create network namespaces. Fix: " + as_root());
    observer_.note("no permission to create network namespaces: both ends run on loopback. Fix: " +
                   as_root());
    hosts_.kind = Hosts::Kind::loopback;
  }
  if (hosts_.kind == Hosts::Kind::loopback)
    hosts_.controller = hosts_.components.front().host = {{}, {}, {}, {}, "lo", "127.0.0.1"};
  Problems problems;
  problems.of([&] { add(controller, hosts_.controller); });
  if (hosts_.kind != Hosts::Kind::alone)
    for (const auto& component : hosts_.components) problems.of([&] { add(component.name, component.host); });
  for (auto& machine : machines_)
    if (machine.second.keeper) problems.of([&] { open(machine.second, transports); });
  problems.tell();
  tell_of_two_ways();
  if (hosts_.kind != Hosts::Kind::namespaces) return;
  auto names = json::array();
  for (const auto& component : hosts_.components) names.push_back(component.name);
  const auto joined = ask(machines_.begin()->second, "join", "joined",
                          {{"components", names}, {"cable", cable_of(hosts_)}, {"wire", asked(hosts_.wire)}});
  for (const auto& [name, host] : joined.at("hosts").items()) hosts_.at(name) = host_of(host);
}

void Machines::add(const std::string& host, const Host& where) {
  auto& machine = machines_[way_to(where)];
  machine.hosts.push_back(host);
  if (machine.hosts.size() > 1) return;  // its keeper is there, or could not be started
  machine.where = where;
  start_keeper(machine);
  machine.keeper->on("window", [this, host](const orders::Frame& frame) {
    if (!window_came_) return;
    try {
      window_came_(host, trace::window_of(frame.message.at("window")));
    } catch (const trace::Error& error) {
      throw Error(3,
                  fmt::format("ontime on the {}'s machine sent an invalid trace ({})", host, error.what()));
    }
  });
  // Both ends cut the link; the time is taken from the controller, whose clock all times are in.
  machine.keeper->on("cut", [this](const orders::Frame& frame) {
    const auto end = std::ranges::find_if(links_, [&](const LinkEnd& link) {
      return link.host == controller && frame.message.at("host") == link.name;
    });
    if (end != links_.end() && was_cut_) was_cut_(end->component, frame.message.at("at_ns"));
  });
}

void Machines::start_keeper(Machine& machine) {
  const auto& where = machine.where;
  const auto name = fmt::format("ontime on the {}'s machine", machine.hosts.front());
  auto command = command_of(where, {}, "keeper");
  if (!where.ssh.empty()) machine.ssh = std::make_unique<Ssh>(where.ssh);
  auto between = between_of(where, machine.ssh.get(), where.host_prefix, command);
  if (machine.ssh) {
    command = machine.ssh->first(command);
    if (hosts_.deploy)
      std::tie(command, between) = deployment(*machine.ssh, where.host_prefix, *hosts_.deploy,
                                              [this] { return coordinator_.interrupted(0); });
  }
  machine.keeper = std::make_unique<Hand>(coordinator_, name, command, "", std::move(between));
}

void Machines::open(Machine& machine, const Transports& transports) {
  std::set<std::string> here;
  for (const auto& host : machine.hosts)
    if (network_namespace(hosts_.at(host)) && transports.contains(host))  // another place has its own files
      here.insert(transports.at(host).begin(), transports.at(host).end());
  const auto opened =
      ask(machine, "open", "opened", {{"transports", here}, {"holder", holder_of(machine.where)}});
  machine.description = record::read<record::Machine>(opened.at("machine"));
  if (machine.ssh && hosts_.deploy)
    for (const auto& host : machine.hosts) hosts_.at(host).program = opened.at("program");
  else
    machine.program = opened.at("program");
  tell(opened.at("notes"));
  if (const std::vector<std::string> lacks = opened.at("lacks"); !lacks.empty())
    throw Error(3, fmt::format("the {}'s machine: {}", machine.hosts.front(), fmt::join(lacks, "; ")));
}

// Two entries that are reached differently are one machine if they have the same boot id.
void Machines::tell_of_two_ways() {
  std::map<std::string, std::string> first_host;  // by boot
  for (const auto& [reach, machine] : machines_) {
    const auto& boot = machine.description.boot_id;
    if (boot.empty()) continue;
    const auto [first, is_new] = first_host.emplace(boot, machine.hosts.front());
    if (!is_new)
      observer_.note(
          fmt::format("the {} and the {} are on one machine, but with different ssh or host prefix: two "
                      "ontimes change its settings. Fix: state the same for both",
                      first->second, machine.hosts.front()));
  }
}

std::unique_ptr<Machines::Hand> Machines::start_agent(const std::string& host,
                                                      const std::string& whom) const {
  const auto& where = hosts_.at(host);
  const auto name = fmt::format("the agent of the {}{}", host, whom);
  auto command = command_of(where, where.command_prefix, "agent");
  const auto& ssh = machine_of(host).ssh;
  auto between = between_of(where, ssh.get(), prefix_of(where, where.command_prefix), command);
  if (ssh) command = ssh->another(command);
  return std::make_unique<Hand>(coordinator_, name, command, agent::sample_layout(), std::move(between));
}

const Machines::Machine& Machines::machine_of(const std::string& host) const {
  const auto found = std::ranges::find_if(
      machines_, [&](const auto& entry) { return std::ranges::count(entry.second.hosts, host) > 0; });
  return found->second;
}

bool Machines::lost() const {
  return std::ranges::any_of(machines_, [](const auto& entry) { return entry.second.keeper->lost(); });
}

void Machines::close() {
  observer_.does("leaving the machines");
  give_back("close", "closed");
}

// Asks every keeper, even if one fails.
void Machines::give_back(const char* order, const char* answer) {
  std::exception_ptr first;
  for (auto& [reach, machine] : machines_) try {
      if (machine.keeper->lost()) continue;
      machine.keeper->order(order);
      tell(coordinator_.await(*machine.keeper, answer, telling(machine), 1).at("notes"));
    } catch (...) {
      if (!first) first = std::current_exception();
    }
  if (first) std::rethrow_exception(first);
}

std::function<void()> Machines::telling(const Machine& machine) {
  return [this, &machine, begun = Clock::now(), next = Clock::now() + silent_wait]() mutable {
    const auto now = Clock::now();
    if (now < next) return;
    next = now + silent_wait;
    const auto& doing = machine.keeper->doing();
    observer_.note(fmt::format("waiting for {} ({} s so far){}", machine.keeper->name(),
                               std::chrono::duration_cast<std::chrono::seconds>(now - begun).count(),
                               doing.empty() ? "" : ": " + doing));
  };
}

bool Machines::leave(Machine& machine) noexcept {
  try {
    // After that many interruptions the user does not want to wait: the keeper continues alone.
    constexpr int tolerated = 1;
    const auto left = machine.keeper->leave([this, tell = telling(machine)]() mutable {
      tell();
      return !coordinator_.interrupted(tolerated);
    });
    tell(left.notes);
    if (left.waits)
      observer_.note(
          fmt::format("{} still restores settings, and continues after this. If any remain later, run "
                      "`ontime tune revert` on that machine",
                      machine.keeper->name()));
    const bool done = left.gave_back || left.waits;
    if (!done)
      observer_.note(
          fmt::format("{} ended before it reported what it restored; a new one restores it now. Load may "
                      "still run. Check: pgrep -a stress-ng",
                      machine.keeper->name()));
    machine.keeper.reset();
    return done;
  } catch (const std::exception& error) {
    observer_.note(error.what());
    return false;
  }
}

void Machines::give_back_anew(Machine& machine) noexcept {
  try {
    machine.ssh.reset();
    start_keeper(machine);
    tell(ask(machine, "open", "opened").at("notes"));
    leave(machine);
  } catch (const std::exception& error) {
    observer_.note(
        fmt::format("ontime on the {}'s machine is lost, and a new one could not be started ({}). Its "
                    "changes may remain. Fix: run `ontime tune revert` there",
                    machine.hosts.front(), error.what()));
  } catch (const orders::Interrupted&) {
    observer_.note(
        fmt::format("interrupted: ontime's changes of the {}'s machine may remain. Fix: run `ontime "
                    "tune revert` there",
                    machine.hosts.front()));
  }
}

void Machines::tell(const json& notes) {
  for (const auto& note : notes) observer_.note(note);
}

json Machines::ask(const Machine& machine, const char* order, const char* answer, json body) const {
  return machine.keeper->ask(order, std::move(body), answer, patience, 1);
}

json Machines::have(const std::string& host, const char* order, const char* answer, json body) const {
  auto answered = ask(machine_of(host), order, answer, std::move(body));
  if (answered.contains("error"))
    throw Error(3, fmt::format("on the {}, {}", host, answered.at("error").get<std::string>()));
  return answered;
}

}  // namespace ontime::campaign

// SPDX-License-Identifier: Apache-2.0
// The machines of a suite, each with a keeper for the whole suite, and the hosts on them.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <set>

#include "background/background.hpp"
#include "campaign/campaign.hpp"
#include "campaign/ssh.hpp"
#include "trace/trace.hpp"

namespace ontime::campaign {

// A host cannot have this setting: "kernel.governor".
struct Refused : Error {
  Refused(const std::string& message, std::string of) : Error(3, message), setting(std::move(of)) {}
  std::string setting;
};

class Machines {
 public:
  using Hand = orders::Coordinator::Hand;

  Machines(orders::Coordinator&, Observer&);
  // Each keeper restores what it changed; for a lost keeper a new one does. Reports what remains changed.
  ~Machines();
  Machines(const Machines&) = delete;
  Machines& operator=(const Machines&) = delete;

  // By host: the transports that its end loads.
  using Transports = std::map<std::string, std::set<std::string>>;

  // Starts a keeper on each machine of the hosts, lets it restore what earlier ontimes left, and creates the
  // hosts that ontime creates itself. Called again after a keeper was lost, it starts all anew. Throws one
  // Error for all hosts that are not reached, have another ontime, or lack a transport, before it creates
  // anything.
  void prepare(const Hosts&, const Transports& = {});
  const Hosts& hosts() const { return hosts_; }
  // Of hosts(), once they are prepared: without permission for namespaces, both ends are on loopback.
  static Hosts::Kind kind_here(const Hosts& stated);
  bool lacks_namespaces() const { return lacks_namespaces_; }  // requested, but both ends are on loopback
  const record::Machine& machine(const std::string& host) const { return machine_of(host).description; }
  bool lost() const;  // whether a keeper is

  bool by_ssh(const std::string& host) const { return machine_of(host).ssh != nullptr; }
  const std::string& program(const std::string& host) const { return machine_of(host).program; }
  // An agent where that host's end lives, called "the agent of the HOST" and `whom`. Throws Error.
  std::unique_ptr<Hand> start_agent(const std::string& host, const std::string& whom) const;

  // Throws Error, with its key, for a link fault that these machines cannot have.
  void check(const Run&);

  // The answer of each host's keeper to the order "look"; without hosts where the keeper cannot look.
  std::map<std::string, nlohmann::json> look(const settings::Wishes&) const;
  // For runs that are measured at the same time: kernel settings, reserved CPUs, load, links and traffic, and
  // what each machine did between begin() and end(). Returns notes for the records: which processes can still
  // use reserved CPUs. Throws Error, with nothing changed, if a machine lacks what is requested: Refused for
  // a kernel setting.
  std::vector<std::string> tune(const Together&);
  // Gives that process on the host's machine the CPUs that tune() reserved. Throws Error.
  void keep(const std::string& host, pid_t) const;
  void restore();  // reports what could not be restored
  // Returns notes for the records: load that is smaller than usual.
  std::vector<std::string> load(const Together&);
  // Schedules the cuts, from now. Reports each cut until unload(), with the component of the link, or "" for
  // the links of all.
  using WasCut = std::function<void(const std::string& component, std::int64_t at_ns)>;
  void cut(WasCut);
  // Keeps the kernels' events from now until unload(). Reports each window that is cut out, with the first
  // host on its machine. Throws Error if no machine can trace.
  using WindowCame = std::function<void(const std::string& host, trace::Window)>;
  void trace(WindowCame);
  // traced(): those machines of the controller and that component that can trace, by first host.
  // how_traced(): of both, by "controller" and "component".
  std::vector<std::string> traced(const std::string& component) const;
  record::ByName<record::Traced> how_traced(const std::string& component) const;
  void cut_out(const std::string& host, const std::vector<trace::Span>&);
  void unload();  // load, link, traffic and trace
  void begin();
  struct Account {
    record::ByName<record::Host> hosts;  // by host: machine, load, kernel settings and reserved CPUs
    record::ByName<record::Activity> conditions;
    // By component, and then by "controller" and "component".
    nlohmann::json traffic = nlohmann::json::object();
    std::map<std::string, record::ByName<record::Link>> links;  // faults and counts of prepared links
    // By component: which of its two ends had traffic on the interface, also another component's.
    std::map<std::string, std::set<std::string>> with_traffic;
    // By the first host of each machine: other ontimes that changed it meanwhile, for people.
    std::map<std::string, std::set<std::string>> others;
  };
  Account end();

  // Restores everything; reports what could not be restored.
  void close();

 private:
  struct Machine {
    Host where;                // as stated
    std::unique_ptr<Ssh> ssh;  // outlives everything that it starts
    std::unique_ptr<Hand> keeper;
    record::Machine description;
    std::string program;  // the path of its ontime; "": copied there until the keeper ends
    std::vector<std::string> hosts;
  };
  // What the keeper of a host needs to know of one end of a link, which it calls by `name`.
  struct LinkEnd {
    std::string host, name, interface;
    background::Faults faults;
    std::optional<Cut> cut;
    std::string component;  // the component of the link; "": all
    std::vector<int> traffic_ports{};
    bool by_ip = false;  // messages are counted by IP, apart from the traffic
  };
  std::vector<LinkEnd> ends_of_links(const Together&) const;
  bool has_ports() const;
  void account_of(const std::map<std::string, record::Link>&, const nlohmann::json& traffic, Account&) const;
  std::string isolate(const std::string& host, const Run&, const nlohmann::json& link);
  const Machine& machine_of(const std::string& host) const;
  nlohmann::json link_of(const std::string& host) const;  // as the orders have it
  void add(const std::string& host, const Host&);
  void tell_of_two_ways();
  void link(const LinkEnd&);
  void start_keeper(Machine&);
  void open(Machine&, const Transports&);
  void give_back(const char* order, const char* answer);
  void leave_all() noexcept;
  bool leave(Machine&) noexcept;  // whether the keeper restores everything by itself
  void give_back_anew(Machine&) noexcept;
  // Reports now and then that a keeper takes long; the keeper must still beat.
  std::function<void()> telling(const Machine&);
  void tell(const nlohmann::json& notes);
  nlohmann::json ask(const Machine&, const char* order, const char* answer,
                     nlohmann::json body = nlohmann::json::object()) const;
  // As ask(), for the machine of a host; throws an answer {error}.
  nlohmann::json have(const std::string& host, const char* order, const char* answer,
                      nlohmann::json body) const;

  orders::Coordinator& coordinator_;
  Observer& observer_;
  Hosts hosts_;
  bool lacks_namespaces_ = false;
  std::set<std::string> warned_;
  bool tuned_ = false, loaded_ = false;
  std::vector<LinkEnd> links_;
  WasCut was_cut_;
  std::map<std::string, record::Traced> traced_;  // by the first host of each machine
  WindowCame window_came_;
  std::map<std::vector<std::string>, Machine> machines_;  // by how they are reached
};

inline constexpr const char* controller = "controller";
// Adds what a keeper knows of the link.
void add_counts(record::Link& to, const record::Link& of_keeper);
// The network namespace of an end, as named by `ip netns`; nothing: its command prefix is another.
std::optional<std::string> network_namespace(const Host&);
// How a machine is reached; hosts with the same way share a machine.
std::vector<std::string> way_to(const Host&);

// Longer than any order takes on a machine under full load.
inline constexpr std::chrono::seconds patience{120};

}  // namespace ontime::campaign

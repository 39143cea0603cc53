// SPDX-License-Identifier: Apache-2.0
// The machines of a suite: a keeper on each, for as long as the suite lasts, and the hosts as they are then.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <set>

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
  // Each keeper gives back what it changed; for a keeper that was lost, a new one does. What stays is told.
  ~Machines();
  Machines(const Machines&) = delete;
  Machines& operator=(const Machines&) = delete;

  // By host: what its end is to load.
  using Transports = std::map<std::string, std::set<std::string>>;

  // Starts a keeper on each machine that the hosts are on, has what earlier ontimes left there given back,
  // and makes the hosts where they are ours to make. Again, where a keeper was lost, it starts all anew.
  // Throws Error, before it makes anything: one for all hosts that are not reached, have another ontime, or
  // lack a transport.
  void prepare(const Hosts&, const Transports& = {});
  const Hosts& hosts() const { return hosts_; }
  const nlohmann::json& machine(const std::string& host) const { return machine_of(host).description; }
  bool lost() const;  // whether a keeper is

  bool by_ssh(const std::string& host) const { return machine_of(host).ssh != nullptr; }
  // An agent where that host's end lives, "the agent of the HOST" and what else there is to say of it. Throws
  // Error.
  std::unique_ptr<Hand> start_agent(const std::string& host, const std::string& whom) const;

  // Throws Error for a fault of the link that cannot be had here, by its name.
  void check(const Run&);

  // Of each host what its keeper answers to the order "look"; nothing of a place where no keeper can look.
  std::map<std::string, nlohmann::json> look(const settings::Wishes&) const;
  // For what is measured at one time: the settings of the kernels and the CPUs that are kept, its load, its
  // links and its traffic, and the account of what each machine did between begin() and end().
  // Returns what their records are to say of which processes may use reserved CPUs all the same. Throws
  // Error, with nothing changed, where a machine lacks what is asked for: Refused for a kernel setting.
  std::vector<std::string> tune(const Together&);
  // That process on the host's machine has the CPUs that tune() kept. Throws Error.
  void keep(const std::string& host, pid_t) const;
  void restore();  // tells what could not be given back
  // Returns what their records are to say of load that is not as large as usual.
  std::vector<std::string> load(const Together&);
  // Counted from now on; when one has come to pass is told, with the component whose link it is, or "" for
  // the links of all, until unload().
  using WasCut = std::function<void(const std::string& component, std::int64_t at_ns)>;
  void cut(WasCut);
  // The kernels' events are kept from now on, until unload(); each window that is cut out is told, with the
  // host whose machine it is of; of one machine for several, the first. Throws Error where no machine can.
  using WindowCame = std::function<void(const std::string& host, trace::Window)>;
  void trace(WindowCame);
  // Of the machines of the controller and of that component, by such a host: those that can; and of all
  // {missing} or {error}, by "controller" and "component".
  std::vector<std::string> traced(const std::string& component) const;
  nlohmann::json how_traced(const std::string& component) const;
  void cut_out(const std::string& host, const std::vector<trace::Span>&);
  void unload();  // load, link, traffic and trace
  void begin();
  struct Account {
    nlohmann::json conditions, load, load_running, kernel, isolation, machine;  // by host
    // By component, and then by "controller" and "component".
    nlohmann::json traffic = nlohmann::json::object(), links = nlohmann::json::object();
    // By component: those of the two on whose interface there was traffic, be it another component's.
    std::map<std::string, std::set<std::string>> with_traffic;
  };
  Account end();

  // Everything is given back; what could not be is told.
  void close();

 private:
  struct Machine {
    Host where;                // as stated
    std::unique_ptr<Ssh> ssh;  // longer than all that is started by it
    std::unique_ptr<Hand> keeper;
    nlohmann::json description;
    std::vector<std::string> hosts;
  };
  // What the keeper of a host is told of one end of a link, under that name.
  struct LinkEnd {
    std::string host, name, interface;
    background::Faults faults;
    std::optional<Cut> cut;
    std::string component;  // whose link it is; "": of all
    std::vector<int> traffic_ports{};
    bool by_ip = false;  // what is beside the traffic is counted by IP
  };
  std::vector<LinkEnd> ends_of_links(const Together&) const;
  bool has_ports() const;
  void account_of(const nlohmann::json& links, const nlohmann::json& traffic, Account&) const;
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
  bool leave(Machine&) noexcept;  // whether the keeper gives back by itself
  void give_back_anew(Machine&) noexcept;
  // Told now and then while a keeper takes long; that keeper is to beat.
  std::function<void()> telling(const Machine&);
  void tell(const nlohmann::json& notes);
  nlohmann::json ask(const Machine&, const char* order, const char* answer,
                     nlohmann::json body = nlohmann::json::object()) const;
  // The same of a host's, and an answer {error} is thrown.
  nlohmann::json have(const std::string& host, const char* order, const char* answer,
                      nlohmann::json body) const;

  orders::Coordinator& coordinator_;
  Observer& observer_;
  Hosts hosts_;
  std::set<std::string> warned_;
  bool tuned_ = false, loaded_ = false;
  nlohmann::json load_given_;  // by host
  std::vector<LinkEnd> links_;
  WasCut was_cut_;
  nlohmann::json traced_;  // by the first host of each machine
  WindowCame window_came_;
  std::map<std::vector<std::string>, Machine> machines_;  // by how they are reached
};

inline constexpr const char* controller = "controller";
// Where an end lives, by the name that `ip netns` has for it; nothing: somewhere else.
std::optional<std::string> network_namespace(const Host&);
// How a machine is reached, by which it is told from others.
std::vector<std::string> way_to(const Host&);

// Longer than anything takes on a machine under full load; only a hang lasts so long.
inline constexpr std::chrono::seconds patience{120};

}  // namespace ontime::campaign

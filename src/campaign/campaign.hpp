// SPDX-License-Identifier: Apache-2.0
// A scenario becomes runs, and runs are carried out on hosts, one after the other, into the results file.
// Ordinary thread only. Everything here throws orders::Error with what asked, what found, what to do.
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "agent/agent.hpp"
#include "background/background.hpp"
#include "isolation/isolation.hpp"
#include "machine/machine.hpp"
#include "orders/orders.hpp"
#include "record/record.hpp"
#include "security/security.hpp"
#include "settings/settings.hpp"

namespace ontime::campaign {

using orders::Error;

// "10 ms" → 10'000'000. Units: ns us µs ms s min h. Throws std::invalid_argument, for people.
std::chrono::nanoseconds duration_of(const std::string& text);
// The same, more than nothing and at most `most`.
constexpr std::chrono::hours longest_duration{1000};  // whose messages can be numbered at the least period
std::chrono::nanoseconds positive_duration(const std::string& text,
                                           std::chrono::hours most = longest_duration);
std::string text_of(std::chrono::nanoseconds);  // the way back, in the largest unit that makes it whole
// "32 KiB" → 32'768. Units: B kB KiB MB MiB GB GiB.
std::uint64_t bytes_of(const std::string& text);
// "80 Mbit/s" → 80'000'000. Units: bit/s kbit/s Mbit/s Gbit/s.
std::uint64_t bit_rate_of(const std::string& text);
// "100 Hz" → 10 ms. Units: Hz kHz. From 0.1 Hz to 100 kHz.
std::chrono::nanoseconds period_of_rate(const std::string& text);
// "1 %" → 0.01. From 0.0001 % to 100 %.
double share_of(const std::string& text);
// A whole number within these bounds. Throws std::invalid_argument, for people.
std::int64_t number_of(const std::string& text, std::int64_t least, std::int64_t most);

// What else goes over the link under test while messages do: UDP, by iperf3.
struct Traffic {
  enum class Direction { both, to_component, to_controller } direction = Direction::both;
  std::uint64_t bits_per_s = 0;         // each way, of payload; 0: no traffic
  std::uint64_t datagram_bytes = 1470;  // the paper's iperf's own choice: a frame of Ethernet is full then
  int priority = 0;                     // SCHED_FIFO, of iperf3 itself; 0: none
  bool operator==(const Traffic&) const = default;
};
const char* word_of(Traffic::Direction);

// That nothing comes over the link, at either end.
struct Cut {
  std::chrono::nanoseconds at;  // after the first counted message was due
  std::chrono::milliseconds length;
};

// One measurement, all conditions stated.
struct Run {
  std::string id;
  std::string title;
  std::string where;  // "FILE:LINE", of a scenario
  std::string
      variant;  // what tells it from others of the same id, beside transport and repetition: "payload 32 KiB"
  std::string adds_to;               // the id of the layer below, where the runs of a session are layers
  std::vector<std::string> require;  // what must be so at the end: gates, checked as such
  // Which key of it a search turns up, and which of its values this is; no key: it is no step of a search.
  struct Step {
    std::string key, value;
    int number = 0, of = 0;  // from 0
    std::string among;       // `variant` without the key: what tells this search from others of the same id
  } step;
  int repetition = 1;
  agent::Task task;  // the client's; the server's follows from it
  background::Workers controller_load, component_load;
  Traffic traffic;
  bool describes_neighbours = false;  // said more of them than how many
  bool explain = false;               // keep what the kernels did around late and lost messages
  background::Faults faults;          // of either end
  std::optional<Cut> cut;             // for which `faults` has to provide
  settings::Wishes kernel;            // of both machines
  isolation::Wish isolation;          // of both machines, for both ends
  std::string component_transport;    // empty: as the controller's, with its options
  std::map<std::string, std::string> component_options;
  security::Level security = security::Level::off;  // of DDS, at both ends
  bool component_restart = false;                   // if it dies while the controller measures
  std::string component = "component";              // the name of the one that answers
  std::vector<Run> own;  // the same of those components of which something else was said, each whole
  std::string beside;    // what it is that varies only for others, which are measured at the same time

  // What was said, of which complete() makes what `task` holds.
  std::optional<int> domain;  // nothing: what ROS_DOMAIN_ID says, or 0
  std::string ros_namespace = "/", ping_topic = "ping", pong_topic = "pong";
  bool realtime_refused =
      false;  // "realtime: off" was said: realtime.* settings then only describe, and do nothing
};

// What can be said of a run, once for scenario files, flags and documentation.
struct Key {
  std::string path;    // in a scenario: "qos.depth"
  std::string flag;    // of `ontime ping` and `ontime pong`: "--depth"; empty: none
  std::string values;  // for people: "1 …"
  std::string help;
  enum class For { client, both } end;
  // Throws std::invalid_argument, for people.
  std::function<void(Run&, const std::string&)> set;
};
const std::vector<Key>& keys();
// A transport's own options: options.NAME, and component.options.NAME where the component has a transport of
// its own.
bool is_option(const std::string& path);
void set_option(Run&, const std::string& path, const std::string& value);
// What only the whole of a run can tell: fills in what follows from other keys. Throws std::invalid_argument.
void complete(Run&);
// The same for the component of that name, where there are several: with its own conditions, if it has any,
// and on topics of its own, /arm/ping for /ping, if its transport has any. Throws std::invalid_argument.
Run with_component(Run, const std::string& name);
// Why that key cannot be said of one of several components alone, for people; "": it can.
std::string common_to_all(const std::string& path);

// Where the two ends are. `reach` and `place` are words put before a command, which run as a program, on this
// machine or, where there is `ssh`, on that one.
struct Host {
  std::string ssh;                 // what OpenSSH's client is told to connect to: "robot", "user@host"
  std::vector<std::string> reach;  // how to reach the machine: {"sudo", "-n"}; nothing: as it is
  std::vector<std::string> place;  // where on it the end lives: {"ip", "netns", "exec", "left"}
  std::string program;             // ontime on that machine; empty: as it is called here, or there by ssh
  std::string interface;
  std::string address;
  std::string port{};  // of a controller's bridge, the one that leads here; "": it has no bridge
};
struct Hosts {
  // alone: the controller only, on this machine; somebody else serves
  enum class Kind { namespaces, loopback, stated, alone } kind = Kind::namespaces;
  Host controller;  // filled in for `stated`, as are these; for `namespaces` with a cable, the interfaces
  struct Component {
    std::string name;
    Host host;
  };
  std::vector<Component> components{{"component", {}}};  // that one, or those that were given names
  const Host& at(const std::string& name) const;         // of the controller, or of a component
  Host& at(const std::string& name);
  machine::Wire wire;  // between two `namespaces`
  // Brought to hosts that are reached by ssh: this program, with these transports. Nothing: it is there.
  std::optional<std::set<std::string>> deploy;
};
const char* word_of(Hosts::Kind);  // alone: ""
// Those that are measured at one time: a run, or one for each of several components.
using Together = std::vector<Run>;
Together together(const Run&, const Hosts&);
nlohmann::json asked(const Run&, const Hosts&);  // the record's form of a run
// The same of each, with what is asked of the others and not of it: they are conditions of it, too.
std::vector<nlohmann::json> asked(const Together&, const Hosts&);
nlohmann::json asked(const machine::Wire&);  // and of that; null: there is none
// Whether its component is one that was given a name.
bool is_named(const Run&);
// The least priority of the threads that a message passes through; 0: of SCHED_OTHER.
int application_priority(const Run&);

struct Scenario {
  std::string file, text, title;
  Hosts hosts;
  std::vector<Run> runs;  // each once, in the order of the file; the steps of a search one after another
  int repeat = 1;
  bool interleaved =
      true;  // all runs once, then all again, so that a drift of the machine falls on all alike

  // What is to be carried out, one after the other; each at the same time between the controller and all
  // components. Of a search it is what its steps are at most.
  std::size_t size() const noexcept { return runs.size() * static_cast<std::size_t>(repeat); }
  Run at(std::size_t number) const;
};
// Of measuring, and of what else a run takes.
std::chrono::duration<double> time_of(const Run&);
std::chrono::duration<double> time_of(const Scenario&);

struct Selection {
  std::vector<std::string> only;        // ids; empty: all
  std::vector<std::string> transports;  // instead of those that the file states
  std::optional<std::chrono::nanoseconds> duration;
  bool deploy = false, explain = false;  // as `explain: on` of each run
  std::vector<std::string> cable{};      // two interfaces of this machine, by which its namespaces are joined
};
// Throws Error{2} with file, line and column. What is too much to be read or carried out is refused as well.
Scenario read_scenario(const std::string& file, const Selection&);
// Those of which a run is selected: an id that is asked for has to be in one of them.
std::vector<Scenario> read_scenarios(const std::vector<std::string>& files, const Selection&);
// The same of a text, which is said to be from that file.
Scenario parse_scenario(const std::string& file, const std::string& text, const Selection&);

// Told of what happens while it happens.
class Observer {
 public:
  virtual ~Observer() = default;
  virtual void note(const std::string& text) = 0;  // something a person should know
  virtual void begins(const Run&) = 0;
  virtual void passes_over(const Run&) = 0;  // it is done already
  virtual void leaves_out(const Run&) = 0;   // the search that it is a step of needs it no more
  virtual void progress(const roundtrip::Counters&, std::chrono::nanoseconds elapsed) = 0;
  virtual void ends(const roundtrip::Counters&) = 0;  // measured to its end, or to an interruption
};

using orders::Interrupts;

// The outcome of a run that is done already; nothing if it is not. Of its record as asked, and of what each
// host's machine is.
using Done =
    std::function<const nlohmann::json*(const nlohmann::json& asked, const nlohmann::json& machines)>;

// Carries out all runs that are not done. Returns the exit code: 0, 2 or 3 as the worst failed run had it
// (the others are carried out all the same), or 130. What was changed on the hosts is taken back when it
// returns or throws.
int execute(const Scenario&, record::Writer&, Observer&, Interrupts&, const nlohmann::json& command_line,
            const Done& done = {});

// One end by hand, on this host. Of what ends before the first message is sent no run is left.
int ping(const Run&, std::chrono::nanoseconds wait, record::Writer&, Observer&, Interrupts&,
         const nlohmann::json& command_line);
// Serves until interrupted. `told` is called once it serves, with the record of what it is. `closed` has what
// there is to be kept, also where it throws.
int pong(const Run&, Observer&, Interrupts&, const std::function<void(const nlohmann::json& opened)>& told,
         nlohmann::json& closed);

}  // namespace ontime::campaign

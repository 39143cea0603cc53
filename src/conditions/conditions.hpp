// SPDX-License-Identifier: Apache-2.0
// Everything that can be asked of a run and its hosts: plain data, and one list of its fields. From the list
// come the keys of scenario files, the flags of ping and pong, the orders to workers and the record's form of
// a run. Adding a condition is a member here, a row in fields.cpp (or network.cpp), and what it does.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "conditions/around.hpp"
#include "realtime/realtime.hpp"
#include "roundtrip/roundtrip.hpp"
#include "settings/settings.hpp"
#include "transport/transport.hpp"

namespace ontime::conditions {

// "10 ms" → 10'000'000. Units: ns us µs ms s min h. Throws std::invalid_argument, for people.
std::chrono::nanoseconds duration_of(const std::string& text);
// A duration that is positive and at most `most`.
constexpr std::chrono::hours longest_duration{1000};  // at the minimum period, message numbers still suffice
std::chrono::nanoseconds positive_duration(const std::string& text,
                                           std::chrono::hours most = longest_duration);
std::string text_of(std::chrono::nanoseconds);  // the inverse, in the largest unit that gives a whole number
// "32 KiB" → 32'768. Units: B kB KiB MB MiB GB GiB.
std::uint64_t bytes_of(const std::string& text);
// "80 Mbit/s" → 80'000'000. Units: bit/s kbit/s Mbit/s Gbit/s.
std::uint64_t bit_rate_of(const std::string& text);
// "100 Hz" → 10 ms. Units: Hz kHz. From 0.1 Hz to 100 kHz.
std::chrono::nanoseconds period_of_rate(const std::string& text);
// "1 %" → 0.01. From 0.0001 % to 100 %.
double share_of(const std::string& text);
std::string text_of_share(double share);  // "12.5 %", with all its digits
// A whole number within these bounds. Throws std::invalid_argument, for people.
std::int64_t number_of(const std::string& text, std::int64_t least, std::int64_t most);

// Why a run cannot have this id, for people; empty: it can.
std::string flaw_of_id(const std::string& id);

// The settings of one process. The defaults change nothing: SCHED_OTHER, pageable memory.
struct RealtimeSettings {
  bool on = false;
  bool lock_memory = false;
  std::optional<std::chrono::microseconds> cpu_latency;
  std::map<std::string, realtime::ThreadSettings> threads;  // by role
};

// The client or the server of one run. For background topics in another process: that process, which opens
// only these topics.
struct Task {
  std::string transport;
  transport::Config config;  // the agent checks `address`; `fifo_priority` follows from `realtime`
  roundtrip::ClientOptions client;
  roundtrip::BackgroundOptions background;
  RealtimeSettings realtime;
  bool count_instructions = false;  // of each thread; makes thread switches a little slower
};

// One measurement, with all its conditions.
struct Run {
  std::string id;
  std::string title;
  std::string where;  // "FILE:LINE", of a scenario
  // The varied keys and values, except transport and repetition: "payload 32 KiB".
  std::string variant;
  // `variant` as pairs of key and value.
  std::vector<std::pair<std::string, std::string>> varied;
  std::string adds_to;               // the id of the layer below, where the runs of a session are layers
  std::vector<std::string> require;  // gates that the run must pass
  // The key that a search raises, and which of its values this is; no key: the run is no step of a search.
  struct Step {
    std::string key, value;
    int number = 0, of = 0;  // from 0
    std::string among;       // `variant` without the key: differs between searches of the same id
  } step;
  int repetition = 1;
  Task task;  // the client's; the server's follows from it
  Workers controller_load, component_load;
  Traffic traffic;
  bool describes_background = false;  // a key of background topics other than `topics` is set
  bool explain = false;               // keep the kernels' events around late and lost messages
  Faults faults;                      // of either end
  std::optional<Cut> cut;             // needs `faults` to be prepared on the link
  settings::Wishes kernel;            // of both machines
  Isolation isolation;                // of both machines, for both ends
  Listening listening;                // on this machine
  std::string component_transport;    // empty: as the controller's, with its options
  std::map<std::string, std::string> component_options;
  Security security = Security::off;    // of DDS, at both ends
  bool component_restart = false;       // if it dies while the controller measures
  std::string component = "component";  // the name of the component with the server
  std::vector<Run> own;                 // all conditions of each component with conditions that differ
  std::string beside;  // varied values of other components that are measured at the same time

  // As stated; scenario::complete() fills `task` from these.
  std::optional<int> domain;  // nothing: ROS_DOMAIN_ID, or 0
  std::string ros_namespace = "/", ping_topic = "ping", pong_topic = "pong";
  bool realtime_refused = false;  // "realtime: off" was stated: realtime.* settings have no effect
};

// A field of a run. Fields with a path are keys of scenarios; fields with `json` are in records and orders.
struct Field {
  std::string path;    // in a scenario: "qos.depth"; "": only in records
  std::string flag;    // of `ontime ping` and `ontime pong`: "--depth"; empty: none
  std::string values;  // for people: "1 …"
  std::string help;
  enum class For { client, both } end = For::client;
  // In tables and labels, around its value: "every {}"; "": its group words it, or the value alone is clear.
  std::string phrase{};
  // In words, of a run that does not state it: "10 ms"; "": nothing is worth telling.
  std::string by_default{};
  enum class Unit { none, us, s, bytes, share, bit_s, hz } unit = Unit::none;  // of its JSON
  // Throws std::invalid_argument, for people.
  std::function<void(Run&, const std::string&)> set{};
  // What that text states, as in a record: the same of "10 ms" and "0.01 s". Throws as `set`. Each field with
  // a path and `json` has it.
  std::function<nlohmann::json(const std::string&)> stated{};
  std::string json{};  // where a record and an order have it: "qos.depth"; "": nowhere
  std::function<nlohmann::json(const Run&)> to_json{};           // null: not written
  std::function<void(Run&, const nlohmann::json&)> from_json{};  // throws std::exception; never gets null
  std::vector<std::string> parts{};  // JSON names that it sets in a record, if `json` is empty
};
using Key = Field;  // one with a path
const std::vector<Field>&
fields();  // all, in the order in which they are applied: a preset before what refines it
const std::vector<Key>& keys();               // all fields with a path
const Key* key_named(std::string_view path);  // null: no key has it
// The current name of a run's key: "background.rate" for the earlier "neighbours.rate", which is still read.
std::string current_key(const std::string& key);

// The JSON form of a run, in orders and in records: docs/reference/json.md lists its names.
nlohmann::json to_json(const Run&);
// Reads that form. Missing fields keep their defaults. Throws std::exception for an invalid value.
Run run_of(const nlohmann::json&);
// Reads a record of any program: invalid values keep their defaults.
Run run_of_record(const nlohmann::json&);
// The record's value of the field of this name; null: it has none.
const nlohmann::json& member_of(const nlohmann::json& record, const std::string& name);

// Where a record stores the scenario's key `key`, or the record's field of that name.
std::vector<nlohmann::json::json_pointer> places_of(const std::string& key);

// The least priority of the threads that a message passes through; 0: of SCHED_OTHER.
int application_priority(const Run&);

const char* word_of(transport::Receive);
const char* word_of(transport::Reliability);
const char* word_of(transport::History);
const char* word_of(transport::Durability);

// Where the client or the server runs. The prefixes are put before each command. The commands run on this
// machine, or, with `ssh`, on that one.
struct Host {
  std::string ssh;                          // destination for OpenSSH's client: "robot", "user@host"
  std::vector<std::string> host_prefix;     // commands that reach the machine: {"sudo", "-n"}; empty: none
  std::vector<std::string> command_prefix;  // where the end runs on it: {"ip", "netns", "exec", "left"}
  std::string program;                      // ontime on that machine; empty: this program, by ssh "ontime"
  std::string interface;
  std::string address;
  std::string port{};  // port of the controller's bridge that leads to this host; "": no bridge
};
struct Hosts {
  // alone: the controller only, on this machine; another program serves
  enum class Kind { namespaces, loopback, stated, alone } kind = Kind::namespaces;
  Host controller;  // set for `stated`, like `components`; for `namespaces` with a cable: the interfaces
  struct Component {
    std::string name;
    Host host;
  };
  std::vector<Component> components{
      {"component", {}}};                         // one without a name, or those that the scenario names
  const Host& at(const std::string& name) const;  // of the controller, or of a component
  Host& at(const std::string& name);
  Wire wire;  // between two `namespaces`
  // Copy this program with these transports to hosts reached by ssh. Nothing: ontime is installed there.
  std::optional<std::set<std::string>> deploy;
};
const char* word_of(Hosts::Kind);  // alone: ""

// A key of a host, or of the wire.
template <typename Of>
struct PartKey {
  std::string path, values, help;  // as a Field's
  // Its value: one word unless it is a list. Throws std::invalid_argument, for people.
  std::function<void(Of&, const std::vector<std::string>& words)> set;
  bool is_list = false;
  std::optional<std::string> earlier{};  // a name that is still read
};
const std::vector<PartKey<Host>>& host_keys();
const std::vector<PartKey<Wire>>& wire_keys();

// The record's form of a run on these hosts.
nlohmann::json asked(const Run&, const Hosts&);
nlohmann::json asked(const Wire&);  // null: no wire is stated
// Whether the scenario names its component.
bool is_named(const Run&);
// HOST or HOST:PORT of messages. Throws std::invalid_argument for an IPv6 address.
void check_address(const std::string&);

}  // namespace ontime::conditions

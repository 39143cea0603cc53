// SPDX-License-Identifier: Apache-2.0
// A scenario file, or flags, become runs: conditions that were checked. It starts no process and looks at no
// machine.
#pragma once

#include <chrono>
#include <map>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "conditions/conditions.hpp"

namespace ontime::scenario {

using conditions::Hosts, conditions::Run;

// "FILE:LINE:COLUMN: " and what is wrong there, for people.
struct Error : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// A transport's own options: options.NAME, and component.options.NAME where the component has a transport of
// its own.
bool is_option(const std::string& path);
void set_option(Run&, const std::string& path, const std::string& value);
// What only the whole of a run can tell: fills in what follows from other keys. Throws std::invalid_argument.
void complete(Run&);
// Every user of ROS 2 says the domain so, of its nodes and of what is to talk to them. Throws
// std::invalid_argument.
int domain_of_environment();
// The run for the component of that name, where there are several: with its own conditions, if it has any,
// and on topics of its own, /arm/ping for /ping, if its transport has any. Throws std::invalid_argument.
Run with_component(Run, const std::string& name);
// Those that are measured at one time: a run, or one for each of several components.
using Together = std::vector<Run>;
Together together(const Run&, const Hosts&);

// Whether its messages go by no IP, which the kernel's packet filter counts; and past all that the kernel
// does to what it sends and receives.
bool is_below_ip(const std::string& transport);
bool is_past_the_kernel(const std::string& transport);
bool any_past_the_kernel(const Run&);  // of its two ends
// A transport may be told a port with an IPv4 address or a name, which no other program knows what to do
// with.
std::string without_port(const std::string& address);

// One line for each key that a file calls by an earlier name, by that name.
using Notices = std::map<std::string, std::string>;

struct Scenario {
  std::string file, text, title;
  Hosts hosts;
  std::vector<Run> runs;  // each once, in the order of the file; the steps of a search one after another
  int repeat = 1;
  // All runs once, then all again, so that a drift of the machine affects all of them alike.
  bool interleaved = true;
  Notices notices{};

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
  std::map<std::string, std::string> set{};  // of each run, instead of what the file states: key → value
};
// Throws Error with file, line and column. What is too much to be read or carried out is refused as well.
Scenario read_scenario(const std::string& file, const Selection&);
// Those of which a run is selected: an id that is asked for has to be in one of them.
std::vector<Scenario> read_scenarios(const std::vector<std::string>& files, const Selection&);
// The same of a text, which is said to be from that file.
Scenario parse_scenario(const std::string& file, const std::string& text, const Selection&);

}  // namespace ontime::scenario

// SPDX-License-Identifier: Apache-2.0
// Makes checked runs of a scenario file or flags. Starts no process, and reads nothing of the machine but
// which transports it has.
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

// A transport's options: options.NAME, and component.options.NAME if the component has another transport.
bool is_option(const std::string& path);
void set_option(Run&, const std::string& path, const std::string& value);
// Fills in what follows from other keys, and checks their combination. Throws std::invalid_argument.
void complete(Run&);
// Whether each transport comes with ontime or is installed on this machine. For runs of this machine: another
// may have transports of its own. Throws std::invalid_argument.
void check_transports(const Run&);
// ROS_DOMAIN_ID, or 0. Throws std::invalid_argument.
int domain_of_environment();
// The run for the component of that name, if there are several: with the conditions for this component, and
// with separate topics (/arm/ping for /ping) if the transport has topics. Throws std::invalid_argument.
Run with_component(Run, const std::string& name);
// Runs that are measured at the same time: one for each component.
using Together = std::vector<Run>;
Together together(const Run&, const Hosts&);

// Whether its messages use no IP, so that the kernel's packet filter does not see them; and whether they
// bypass the kernel's network stack.
bool is_below_ip(const std::string& transport);
bool is_past_the_kernel(const std::string& transport);
bool any_past_the_kernel(const Run&);  // of its two ends
// Why a run cannot be measured over a transport with these capabilities, beyond what the agent that opens the
// transport checks; "": it can. complete() asks where the transport is installed, else the coordinator does
// once the agent has reported the capabilities.
std::string why_not_by(const std::string& transport, const transport::Capabilities&, const Run&,
                       const conditions::Wire&);
// The address without the port, which only a transport understands.
std::string without_port(const std::string& address);

// One line for each earlier name of a key in the file, by that name.
using Notices = std::map<std::string, std::string>;

struct Scenario {
  std::string file, text, title;
  Hosts hosts;
  std::vector<Run> runs;  // each once, in the order of the file; the steps of a search one after another
  int repeat = 1;
  // All runs once, then all again, so that a drift of the machine affects all of them alike.
  bool interleaved = true;
  Notices notices{};

  // Number of runs to measure one after the other, each with all components at once. For a search, the most.
  std::size_t size() const noexcept { return runs.size() * static_cast<std::size_t>(repeat); }
  Run at(std::size_t number) const;
};
// Expected time, with start and warm-up.
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
// Throws Error with file, line and column, also for more than can be read or measured.
Scenario read_scenario(const std::string& file, const Selection&);
// Only scenarios with a selected run. Throws Error if no scenario has a selected id.
std::vector<Scenario> read_scenarios(const std::vector<std::string>& files, const Selection&);
// Reads `text`; errors name `file`.
Scenario parse_scenario(const std::string& file, const std::string& text, const Selection&);

}  // namespace ontime::scenario

// SPDX-License-Identifier: Apache-2.0
// Carries out runs on hosts, one after the other, and writes the results file. Ordinary thread only.
// Everything here throws orders::Error with what was requested, what was found, and what to do.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "conditions/conditions.hpp"
#include "orders/orders.hpp"
#include "record/outcome.hpp"
#include "scenario/scenario.hpp"

namespace ontime::record {
class Writer;
}
namespace ontime::trace {
struct Window;
}

namespace ontime::campaign {

using namespace conditions;  // everything here is about runs and hosts
using namespace scenario;
using orders::Error;  // of carrying out; what is wrong with a scenario is a scenario::Error

using conditions::asked;
// The record of each run. It also holds the conditions of the other runs at the same time, where they differ.
std::vector<nlohmann::json> asked(const Together&, const Hosts&);

// Gets a call for each event, as it happens.
class Observer {
 public:
  virtual ~Observer() = default;
  virtual void note(const std::string& text) = 0;    // something a person should know
  virtual void does(const std::string& /*what*/) {}  // between messages: "starting load"
  virtual void begins(const Run&) = 0;
  virtual void passes_over(const Run&) = 0;  // it is already in the results
  virtual void leaves_out(const Run&) = 0;   // its search no longer needs this step
  virtual void progress(const roundtrip::Counters&, std::chrono::nanoseconds elapsed) = 0;
  virtual void ends(const roundtrip::Counters&) = 0;  // measured to its end, or to an interruption
  virtual void recorded(std::int64_t /*run*/) {}      // its record is complete, however it ended
  // Listening to the robot's own messages, if a run requests it: from just before its first message, which
  // waits until listens(), to its last. An error that these throw fails the run.
  virtual void begins_listening(const Run&);
  virtual bool listens() { return true; }
  virtual void ends_listening(bool /*interrupted*/) {}
};

// How to run it with root's rights: this command line with sudo before it, to paste, or how to start the
// container. Without the command where another user may read it.
std::string as_root(bool with_command = true);

using orders::Interrupts;

// Returns the outcome of a run that is already in the results, by its requested record and the machines of
// "controller" and "component", as far as they are known yet; null if it is not.
using Done = std::function<const record::Outcome*(const nlohmann::json& asked,
                                                  const record::ByName<record::Machine>& machines)>;

// What execute() will measure, at most: searches may need fewer of their steps.
struct Plan {
  std::size_t runs = 0, known = 0;        // all; those that are already in the results and of no search
  std::chrono::duration<double> time{0};  // of the others
};
Plan plan_of(const Scenario&, const Done& done = {});

// Carries out all runs that are not done. Returns the exit code: 0, 2 or 3 as the worst failed run had it
// (the others are still carried out), or 130. Changes on the hosts are undone when it returns or
// throws.
int execute(const Scenario&, record::Writer&, Observer&, Interrupts&, const nlohmann::json& command_line,
            const Done& done = {});

// The machines of a scenario before its runs: each is looked at by its keeper, which lives as long as this.
// Nothing is changed on them; namespaces of the scenario are made and removed.
class Look {
 public:
  Look(const Scenario&, Observer&, Interrupts&);  // throws Error, orders::Interrupted
  ~Look();
  Look(const Look&) = delete;
  Look& operator=(const Look&) = delete;

  // Why a host cannot have this value of this key in the scenario's first run, for people; "": all can, or
  // only a run shows it.
  std::string why_not(const std::string& key, const std::string& value) const;
  record::ByName<record::Machine> machines() const;  // of "controller" and "component"
  int most_cpus() const;                             // the highest number of online CPUs of a machine
  struct Place {
    settings::Link link;  // of its messages; an interface "": not known, or created for the runs
    std::string program;  // the path of its ontime; "": copied there for the runs
    bool by_ssh = false;
  };
  std::map<std::string, Place> places() const;  // by host

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

// The client alone, on this host. A run that ends before its first message is not recorded.
int ping(const Run&, std::chrono::nanoseconds wait, record::Writer&, Observer&, Interrupts&,
         const nlohmann::json& command_line);
// What pong did, as far as it is known.
struct Served {
  std::optional<std::uint64_t> answered;          // messages; nothing: it did not end in order
  record::Outcome outcome;                        // of each of its records, with `explain`
  std::vector<std::vector<trace::Window>> pings;  // the windows of each client, with `explain`
};
// Serves until interrupted. `told` is called with its end once it serves. `served` receives the result, also
// if this throws.
int pong(const Run&, Observer&, Interrupts&, const std::function<void(const record::Host& opened)>& told,
         Served& served);

}  // namespace ontime::campaign

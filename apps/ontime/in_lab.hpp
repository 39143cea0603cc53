// SPDX-License-Identifier: Apache-2.0
// The lab's machine for commands: its flags, and the runs measured in it.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "command.hpp"
#include "lab/lab.hpp"
#include "measured.hpp"
#include "terminal.hpp"

namespace ontime::app {

// --nic, --deterministic, --live, --cpus, --kernel, --memory, --with.
class LabFlags {
 public:
  // Its values must live until the command has run. `title`: their group in --help; "": the usual one.
  void add(Command&, const std::string& title = "");
  lab::Machine machine() const;     // throws Error{2} that names the flag
  std::string first_given() const;  // by the user: "--nic"; "": none

 private:
  lab::Machine machine_;
  std::vector<std::string> with_;
  std::string memory_;
  std::optional<int> cpus_;
  bool live_ = false;
  std::vector<Option*> options_;
};

lab::Observer observer_of(Terminal&, const campaign::Interrupts&);

// A command that measures scenarios in the machine. Each complete run is copied out at once.
struct LabTask {
  std::vector<std::string> command;    // "ontime", "run"
  std::vector<std::string> scenarios;  // files here
  const Choice& choice;
  bool resume = false;              // skip runs that the results here have
  std::vector<std::string> more{};  // further flags
};
struct LabEnd {
  int code = 0;            // the command's, 3 if the machine failed, or 130
  std::string unfinished;  // why the machine failed or was stopped, for people; "": neither
  std::string said;        // the last line that the command wrote
};

// Checks the task before a machine starts; throws Error{2}. All scenarios must have hosts: namespaces, and
// the same wire speed, which the NICs get.
class InLab {
 public:
  InLab(lab::Machine, LabTask);
  // Adds the runs to the results. Throws lab::Error if the machine failed before the first run.
  LabEnd measure(record::Writer&, Terminal&, const campaign::Interrupts&);

 private:
  std::string name_here(const std::string& there) const;
  std::vector<std::string> command() const;
  lab::Machine machine_;
  const LabTask task_;
  std::vector<lab::File> scenarios_;
};

// Called inside the machine: copies this run out, as its own results file.
void send_from_lab(record::Writer&, std::int64_t run, const std::string& to);

}  // namespace ontime::app

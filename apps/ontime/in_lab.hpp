// SPDX-License-Identifier: Apache-2.0
// The lab's machine as commands ask for it, and what they have measured there.
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

// A command that measures scenarios there, of which each run leaves the machine as soon as it is complete.
struct LabTask {
  std::vector<std::string> command;    // "ontime", "run"
  std::vector<std::string> scenarios;  // files here
  const Choice& choice;
  bool resume = false;              // from what is in the results here
  std::vector<std::string> more{};  // its flags
};
struct LabEnd {
  int code = 0;            // the command's, 3 if the machine failed, or 130
  std::string unfinished;  // why its machine failed or was ended, for people; "": it did not
  std::string said;        // the last line that the command wrote
};

// Checks the task before any machine starts: throws Error{2}. All scenarios have hosts: namespaces, and one
// speed of the wire, which the NICs then have.
class InLab {
 public:
  InLab(lab::Machine, LabTask);
  // Into the results. Throws lab::Error if the machine failed before the first run.
  LabEnd measure(record::Writer&, Terminal&, const campaign::Interrupts&);

 private:
  std::vector<std::string> command() const;
  lab::Machine machine_;
  const LabTask task_;
  std::vector<lab::File> scenarios_;
};

// In the machine: this run of the results leaves it, as a results file of its own.
void send_from_lab(record::Writer&, std::int64_t run, const std::string& to);

}  // namespace ontime::app

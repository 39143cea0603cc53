// SPDX-License-Identifier: Apache-2.0
// The flags for CI: --fail-if and --junit.
#pragma once

#include <string>
#include <vector>

#include "command.hpp"
#include "gate/gate.hpp"

namespace ontime::app {

class GateFlags {
 public:
  GateFlags(Command&, gate::Use);
  // Each throws Error{2} that names the flag.
  std::vector<gate::Gate> gates() const;
  // Before measuring: a killed process must not leave the verdict of an earlier one in the file of --junit.
  void begin_junit() const;

  bool wanted() const { return !fail_if_.empty() || !junit_.empty(); }
  // Judges one run by gate::judge_all(); for JUnit also whether it was measured as requested.
  std::vector<gate::Judgement> judge(const std::vector<gate::Gate>&, const statistics::Summary&) const;
  // Judges runs that no later run supersedes; nothing if neither flag was given.
  std::vector<gate::Judgement> judge_wanted(const std::vector<gate::Gate>&,
                                            const std::vector<statistics::Summary>&) const;

  // Writes the JUnit file, prints what did not hold or is uncertain on standard error, and returns the exit
  // code: 0 or 1. `file`: the judged file; without judgements it fails. `shown`: standard output has them;
  // the same terminal gets none twice.
  int finish(std::vector<gate::Judgement>, const std::string& file, bool shown = false) const;

 private:
  const gate::Use use_;
  std::vector<std::string> fail_if_;
  std::string junit_;
};

}  // namespace ontime::app

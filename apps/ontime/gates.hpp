// SPDX-License-Identifier: Apache-2.0
// The flags by which a CI holds a line: --fail-if and --junit.
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

  bool wanted() const { return !fail_if_.empty() || !junit_.empty(); }
  // Of a run by itself: gate::judge_all(); for JUnit also whether it was measured as asked.
  std::vector<gate::Judgement> judge(const std::vector<gate::Gate>&, const statistics::Summary&) const;
  // Of runs without those that a later one supersedes; nothing if neither flag was given.
  std::vector<gate::Judgement> judge_wanted(const std::vector<gate::Gate>&,
                                            const std::vector<statistics::Summary>&) const;

  // Prints on standard error what is not plainly ok, writes the JUnit file, and returns the exit code: 0
  // or 1. `file`: what was judged; if it had nothing to judge, that is no pass.
  int finish(std::vector<gate::Judgement>, const std::string& file) const;

 private:
  const gate::Use use_;
  std::vector<std::string> fail_if_;
  std::string junit_;
};

}  // namespace ontime::app

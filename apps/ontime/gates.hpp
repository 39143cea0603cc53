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
  // A run by itself: by the gates that are absolute, and by what its scenario required of it; for JUnit,
  // whether it was measured to its end.
  std::vector<gate::Judgement> judge(const std::vector<gate::Gate>&, const statistics::Summary&) const;

  // `file`: what was judged, for who asked for judgements and there was nothing to judge: that is no pass.
  // Says on standard error what did not hold, and what held only because it cannot be told; writes the JUnit
  // file, and returns the exit code: 0 or 1.
  int finish(std::vector<gate::Judgement>, const std::string& file) const;

 private:
  const gate::Use use_;
  std::vector<std::string> fail_if_;
  std::string junit_;
};

}  // namespace ontime::app

// SPDX-License-Identifier: Apache-2.0
#include "gates.hpp"

#include <algorithm>
#include <iterator>

#include <fmt/format.h>
#include <unistd.h>

#include "flags.hpp"
#include "output.hpp"
#include "report/report.hpp"
#include "terminal.hpp"

namespace ontime::app {

using gate::Judgement;

GateFlags::GateFlags(Command& command, gate::Use use) : use_(use) {
  const auto* const example = use == gate::Use::fail_if
                                  ? "exit with 1 if this holds for a run: 'response late > 0', 'p99.9 > 2 ms'"
                                  : "exit with 1 if this holds: 'p99.9 > +10%', 'response late > 0'";
  command.add_option("--fail-if", fail_if_, example, "GATE")->one_a_flag();
  add_file(command, "--junit", junit_,
           "write the pass or fail of each requirement to this file, as JUnit XML");
}

void GateFlags::begin_junit() const {
  if (junit_.empty() || is_written_in_place(junit_)) return;
  const Judgement unknown{Judgement::Result::cannot_judge, "ontime", "ontime ends",
                          "it was killed, failed, or is still running"};
  write_whole(junit_, report::junit({unknown}), Kind::junit);
}

std::vector<gate::Gate> GateFlags::gates() const {
  // Before measuring. Protects other files, such as the scenario or a robot's description.
  if (!junit_.empty() && !is_written_in_place(junit_)) Output(junit_, Kind::junit);
  std::vector<gate::Gate> gates;
  for (const auto& text : fail_if_) {
    try {
      gates.push_back(gate::parse(text, use_));
    } catch (const gate::Error& error) {
      throw wrong("--fail-if: '{}', {}", text, error.what());
    }
  }
  return gates;
}

std::vector<Judgement> GateFlags::judge(const std::vector<gate::Gate>& gates,
                                        const statistics::Summary& run) const {
  auto judgements = gate::judge_all(gates, run);
  const bool only_why = judgements.size() == 1 && judgements.front().gate == gate::as_asked;
  if (!junit_.empty() && !only_why) judgements.insert(judgements.begin(), gate::judge_as_asked(run));
  return judgements;
}

std::vector<Judgement> GateFlags::judge_wanted(const std::vector<gate::Gate>& gates,
                                               const std::vector<statistics::Summary>& runs) const {
  std::vector<Judgement> all;
  if (!wanted()) return all;
  for (const auto& run : runs)
    if (!gate::is_superseded(run, runs)) std::ranges::move(judge(gates, run), std::back_inserter(all));
  return all;
}

int GateFlags::finish(std::vector<Judgement> judgements, const std::string& file, bool shown) const {
  shown = shown && isatty(STDOUT_FILENO) != 0 && isatty(STDERR_FILENO) != 0;
  if (wanted() && judgements.empty()) {
    shown = false;
    judgements.push_back(
        {Judgement::Result::cannot_judge, file, "the file has a run", "the file has no run"});
  }
  if (!junit_.empty()) write_whole(junit_, report::junit(judgements), Kind::junit);  // first, as for CI
  int code = 0;
  for (const auto& judgement : judgements) {
    const bool held = judgement.result == Judgement::Result::held;
    if (!held) code = 1;
    if (!shown && (!held || !judgement.is_sure)) print_error(gate::text_of(judgement));
  }
  return code;
}

}  // namespace ontime::app

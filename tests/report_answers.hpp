// SPDX-License-Identifier: Apache-2.0
// Runs for the first screen.
#pragma once

#include "report/answer.hpp"
#include "report_fixture.hpp"

namespace ontime::report {

inline const Origin kept{.file = "demo.ontime", .is_root = true, .is_own = true};

struct Conditions {
  bool load = false, realtime = false;
};
inline Summary run(std::int64_t number, const std::string& id, const std::string& transport,
                   Conditions conditions, std::uint64_t missed = 0, int repetition = 1) {
  auto one = summary(asked(id, transport, repetition), outcome());
  if (!conditions.load) amend(one.run.asked, "/load", {{"controller", {{"cpu", 0}, {"hdd_bytes", 0}}}});
  amend(one.run.asked, "/realtime", conditions.realtime);
  amend(one.run.asked, "/scenario_file", "/home/me/scenarios/demo.yaml");
  one.run.number = number;
  one.run.key = id + transport;
  one.late = one.late_by_response.emplace(missed);
  one.on_time = one.sent - missed;
  return one;
}

// The demo's: idle, load, both with real-time settings; the load is what makes messages late.
inline std::vector<Summary> demo() {
  std::vector<Summary> runs;
  std::int64_t number = 0;
  for (const auto& [id, conditions] : {std::pair<const char*, Conditions>{"Test1.A", {}},
                                       {"Test1.B", {true, false}},
                                       {"Test1.C", {false, true}},
                                       {"Test1.D", {true, true}}})
    for (const auto* transport : {"udp", "cyclonedds", "fastdds"}) {
      ++number;
      const auto missed = conditions.load && !conditions.realtime ? 320 + number * 40 : 0;
      runs.push_back(run(number, id, transport, conditions, static_cast<std::uint64_t>(missed)));
    }
  return runs;
}

// Too short to prove that less than 1 in 10,000 is late, which takes 5 minutes.
inline Summary run_without_a_late_message() {
  auto one = run(1, "a", "udp", {});
  one.missed_probability.messages = 2000;
  one.missed_probability.bound = 1.5e-3;
  one.message_every_ns = 10 * ms;
  return one;
}

inline std::vector<std::string> commands_of(const Answer& answer) {
  std::vector<std::string> commands;
  for (const auto& step : answer.next) commands.push_back(step.command);
  return commands;
}

}  // namespace ontime::report

// SPDX-License-Identifier: Apache-2.0
// Runs that gates judge.
#pragma once

#include "amend.hpp"
#include "gate/gate.hpp"

namespace ontime::gate {

inline statistics::Measured measured(double ms, std::optional<double> low_ms, std::optional<double> high_ms) {
  const auto ns = [](std::optional<double> value) {
    return value ? std::optional(*value * 1e6) : std::nullopt;
  };
  statistics::Measured result;
  result.value = ms * 1e6;
  result.sure = result.surer = {ns(low_ms), ns(high_ms)};
  return result;
}

inline statistics::Summary run(const statistics::Measured& p99, std::uint64_t late = 0) {
  statistics::Summary run;
  run.run.number = 5;
  run.run.asked = nlohmann::json{{"id", "Test1.B"}, {"transport", "udp"}, {"repetition", 2}};
  run.run.outcome = nlohmann::json{{"interrupted", false}};
  run.sent = 1000;
  run.late = late;
  run.on_time = 1000 - late;
  run.round_trip.count = 1000;
  run.round_trip.max = 7'000'000;
  run.shape.round_trip_ranks = {{1000, 1'000'000}};
  run.round_trip_certainty[statistics::Figure::p99] = p99;
  return run;
}

Judgement judged(const char* text, const statistics::Summary& of) {
  return judge(parse(text, Use::fail_if), of);
}

}  // namespace ontime::gate

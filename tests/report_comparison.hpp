// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "report/comparison.hpp"
#include "report_fixture.hpp"

namespace ontime::report {

// A run with this key whose p99 is so many ms, surely within a tenth of it.
inline Summary run(const std::string& id, const std::string& key, double p99_ms, std::int64_t number = 1) {
  auto one = summary(asked(id, "udp"), outcome());
  one.run.key = key;
  one.run.number = number;
  statistics::Measured p99;
  p99.value = p99_ms * 1e6;
  p99.sure = p99.surer = {p99.value * 0.9, p99.value * 1.1};
  one.round_trip_certainty[statistics::Figure::p99] = p99;
  return one;
}

}  // namespace ontime::report

// SPDX-License-Identifier: Apache-2.0
// Numbers from samples. Exact: every counted sample is in, late ones too; lost ones have no round trip and
// are counted by themselves. Ordinary thread.
#pragma once

#include <cstdint>
#include <vector>

#include <nlohmann/json.hpp>

#include "record/record.hpp"

namespace ontime::statistics {

// Percentiles by nearest rank: the smallest value that at least p % of the values do not exceed
// (Hyndman & Fan 1996, definition 1). Nanoseconds.
struct Distribution {
  std::uint64_t count = 0;
  std::int64_t min = 0, p50 = 0, p90 = 0, p99 = 0, p99_9 = 0, p99_99 = 0, max = 0;
  double mean = 0;
};
// Sorts `values`. All zero for no values.
Distribution distribution(std::vector<std::int64_t>& values);

// Of one run. sent = on_time + late + lost.
struct Summary {
  record::Run run;
  std::uint64_t sent = 0, on_time = 0, late = 0, lost = 0, skipped_cycles = 0;
  Distribution round_trip;  // sent → received: the paper's T2 − T1
  Distribution response;    // intended → received: hides no stall
  Distribution wake_up;     // due → woke, of the sending thread; none in back-to-back
  Distribution server;      // received → sent, on the server's clock; count 0 if the server did not say
};
Summary summarise(const record::Reader&, const record::Run&);

}  // namespace ontime::statistics

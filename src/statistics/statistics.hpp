// SPDX-License-Identifier: Apache-2.0
// Numbers from samples. Exact: every counted sample is in, late ones too; lost ones have no round trip and
// are counted by themselves. Ordinary thread.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
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

// A quantity that was found several times, and how sure its median is. The interval runs between two order
// statistics and covers the median with the stated probability whatever the distribution (sign test; Conover
// 1999, ch. 3.2): the narrowest symmetric one of at least 95 %, or, of fewer than six values, all that they
// span.
struct Estimate {
  std::size_t count = 0;
  double median = 0, low = 0, high = 0;
  double confidence = 0;
};
std::optional<Estimate> estimate(std::vector<double> values);  // nothing of nothing

// What one layer of a stack costs a message: a run, against the run that it is said to add to, repetition by
// repetition of one session. `added` is nothing for the lowest layer, and where the other run was not made.
struct Cost {
  std::optional<Estimate> total, added;
};
struct Layer {
  std::string id, transport, adds_to;
  Cost round_trip_ns;  // the median message's
  Cost cpu_ns;         // a message, of all recorded threads on both hosts
  Cost instructions;   // likewise; nothing where they were not counted
};
// In the order in which they were first run; runs that neither add to another nor are added to are left out.
std::vector<Layer> layers(const std::vector<Summary>&);

}  // namespace ontime::statistics

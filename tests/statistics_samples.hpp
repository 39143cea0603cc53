// SPDX-License-Identifier: Apache-2.0
// Runs of few samples.
#pragma once

#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "statistics/statistics.hpp"

namespace ontime::statistics {

using roundtrip::Fate;
using roundtrip::Sample;

inline constexpr std::int64_t us = 1000, ms = 1'000'000;

inline const nlohmann::json asked_next_free = {{"schedule", "next-free"},
                                               {"period_us", 10'000.0},
                                               {"deadline_us", 10'000.0},
                                               {"timeout_us", 500'000.0},
                                               {"duration_s", 100.0}};

inline Summary summary_of(const std::vector<Sample>& samples, const nlohmann::json& asked,
                          const nlohmann::json& outcome = nullptr) {
  record::Writer writer("");
  const auto run = writer.begin_run(asked);
  writer.append(run, samples);
  if (!outcome.is_null()) writer.end_run(run, outcome);
  writer.flush();
  const auto reader = writer.reader();
  return summarise(reader, reader.runs().at(0));
}

inline Sample answered(std::uint64_t index, std::int64_t intended_ns, std::int64_t skipped,
                       std::int64_t took_ns) {
  Sample sample{};
  sample.index = index;
  sample.intended_ns = intended_ns;
  sample.due_ns = intended_ns + skipped * 10 * ms;
  sample.skipped_cycles = static_cast<std::uint32_t>(skipped);
  sample.woke_ns = sample.due_ns + 50 * us;
  sample.sent_ns = sample.woke_ns + us;
  sample.received_ns = sample.sent_ns + took_ns;
  sample.fate = took_ns > 10 * ms ? Fate::late : Fate::on_time;
  return sample;
}

inline Sample lost(std::uint64_t index, std::int64_t intended_ns, std::int64_t skipped) {
  auto sample = answered(index, intended_ns, skipped, 0);
  sample.received_ns = 0;
  sample.fate = Fate::lost;
  return sample;
}

}  // namespace ontime::statistics

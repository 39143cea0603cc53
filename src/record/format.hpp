// SPDX-License-Identifier: Apache-2.0
// The tables of a results file, as docs/reference/results-file.md describes them, and how those of an older
// format become them.
#pragma once

#include <cstdint>

#include "record/connection.hpp"
#include "roundtrip/sample.hpp"

namespace ontime::record {

inline constexpr std::int64_t format_version = 4;  // user_version, in the file's header

// The format of the file; 0 if it holds nothing. Throws if it is not a results file, has a format that this
// ontime does not know, or its tables are not those of its format: additional
// columns are accepted.
std::int64_t format_of(Connection&);

void create_tables(Connection&);
// Converts an earlier format, except for run.key. Call both in a transaction.
void migrate_tables(Connection&, std::int64_t from);

// Conversion for the file and back. Exact for every pair of numbers, also if the difference overflows an
// int64.
constexpr std::int64_t difference(std::int64_t later, std::int64_t earlier) {
  return static_cast<std::int64_t>(static_cast<std::uint64_t>(later) - static_cast<std::uint64_t>(earlier));
}
constexpr std::int64_t sum(std::int64_t earlier, std::int64_t difference) {
  return static_cast<std::int64_t>(static_cast<std::uint64_t>(earlier) +
                                   static_cast<std::uint64_t>(difference));
}

// The limit is 36 years since boot. Calculations with times within it do not overflow.
constexpr bool can_be(std::int64_t time_ns) {
  constexpr std::int64_t most = std::int64_t{1} << 60;
  return -most <= time_ns && time_ns <= most;
}
constexpr bool can_be(const roundtrip::Sample& sample) {
  return can_be(sample.intended_ns) && can_be(sample.due_ns) && can_be(sample.woke_ns) &&
         can_be(sample.sent_ns) && can_be(sample.received_ns) && can_be(sample.server_received_ns) &&
         can_be(sample.server_sent_ns) && can_be(sample.passed_wake_ns) && sample.passed_wake_ns >= 0 &&
         (sample.fate == roundtrip::Fate::lost
              ? sample.received_ns == 0
              : sample.fate < roundtrip::Fate::lost && sample.received_ns >= sample.sent_ns);
}

}  // namespace ontime::record

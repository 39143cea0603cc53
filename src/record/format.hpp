// SPDX-License-Identifier: Apache-2.0
// The tables of a results file, as docs/results-file.md describes them.
#pragma once

#include <cstdint>

namespace ontime::record {

// In the file's header.
inline constexpr std::int64_t application_id = 0x6f6e746d;  // "ontm"
inline constexpr std::int64_t format_version = 1;           // user_version

// Times of a sample are kept as differences, each after the one before it: SQLite stores small numbers in few
// bytes. Anything that is usual (no skipped cycle, on time) is 0, which takes none.
inline constexpr const char* schema = R"(
PRAGMA application_id = 0x6f6e746d;
PRAGMA user_version = 1;
CREATE TABLE run (
  number INTEGER PRIMARY KEY,
  started_at TEXT NOT NULL,  -- UTC
  start_ns INTEGER,          -- intended time of the first message: CLOCK_MONOTONIC of the client
  asked TEXT NOT NULL,       -- JSON
  outcome TEXT,              -- JSON; NULL: the run was cut off, or goes on
  id TEXT AS (json_extract(asked, '$.id')),
  transport TEXT AS (json_extract(asked, '$.transport')),
  repetition INTEGER AS (json_extract(asked, '$.repetition'))
);
CREATE TABLE sample (
  run INTEGER NOT NULL,
  message INTEGER NOT NULL,        -- from 0, in the order of sending
  intended_ns INTEGER NOT NULL,    -- after run.start_ns
  due_after_ns INTEGER NOT NULL,   -- after intended
  woke_after_ns INTEGER NOT NULL,  -- after due
  sent_after_ns INTEGER NOT NULL,  -- after woke
  received_after_ns INTEGER,       -- after sent: the round trip; NULL: lost
  server_received_ns INTEGER,      -- CLOCK_MONOTONIC of the server; NULL: it did not say
  server_sent_after_ns INTEGER,    -- after server_received
  skipped_cycles INTEGER NOT NULL,
  fate INTEGER NOT NULL,           -- 0 on time, 1 late, 2 lost
  PRIMARY KEY (run, message)
) WITHOUT ROWID;
CREATE VIEW message AS
SELECT sample.run, id, transport, repetition, message,
       CASE fate WHEN 0 THEN 'on time' WHEN 1 THEN 'late' WHEN 2 THEN 'lost' END AS fate, skipped_cycles,
       intended_ns / 1e9 AS intended_s,
       woke_after_ns / 1e3 AS wake_up_us,
       received_after_ns / 1e3 AS round_trip_us,
       (due_after_ns + woke_after_ns + sent_after_ns + received_after_ns) / 1e3 AS response_us,
       server_sent_after_ns / 1e3 AS server_us
FROM sample JOIN run ON run.number = sample.run;
)";

// The way into the file and back, exact for every pair of numbers, also for those whose difference is no
// int64.
constexpr std::int64_t difference(std::int64_t later, std::int64_t earlier) {
  return static_cast<std::int64_t>(static_cast<std::uint64_t>(later) - static_cast<std::uint64_t>(earlier));
}
constexpr std::int64_t sum(std::int64_t earlier, std::int64_t difference) {
  return static_cast<std::int64_t>(static_cast<std::uint64_t>(earlier) +
                                   static_cast<std::uint64_t>(difference));
}

}  // namespace ontime::record

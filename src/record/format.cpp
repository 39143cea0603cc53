// SPDX-License-Identifier: Apache-2.0
#include "record/format.hpp"

#include <algorithm>
#include <functional>
#include <set>
#include <string_view>
#include <vector>

#include <fmt/format.h>

#include "record/record.hpp"

namespace ontime::record {
namespace {

constexpr std::int64_t application_id = 0x6f6e746d;  // "ontm", in the file's header

// Times of a sample are kept as differences, each after the one before it: SQLite stores small numbers in few
// bytes. Anything that is usual (no skipped cycle, on time) is 0, which takes none. Columns of later formats
// come last, where ALTER TABLE puts them, so that all files of a format are alike.
constexpr const char* run_and_sample = R"(
PRAGMA application_id = 0x6f6e746d;
CREATE TABLE run (
  number INTEGER PRIMARY KEY,
  started_at TEXT NOT NULL,  -- UTC
  start_ns INTEGER,          -- intended time of the first message: CLOCK_MONOTONIC of the client
  asked TEXT NOT NULL,       -- JSON
  outcome TEXT,              -- JSON; NULL: the run was cut off, or goes on
  id TEXT AS (json_extract(asked, '$.id')),
  transport TEXT AS (json_extract(asked, '$.transport')),
  repetition INTEGER AS (json_extract(asked, '$.repetition')),
  key TEXT NOT NULL DEFAULT ''  -- the same for the same conditions
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
  passed_wake_ns INTEGER NOT NULL DEFAULT 0,  -- the longest wake-up for one of the skipped cycles
  PRIMARY KEY (run, message)
) WITHOUT ROWID;
)";

constexpr const char* from_format_1 = R"(
ALTER TABLE run ADD COLUMN key TEXT NOT NULL DEFAULT '';
ALTER TABLE sample ADD COLUMN passed_wake_ns INTEGER NOT NULL DEFAULT 0;
DROP VIEW IF EXISTS message;
)";

constexpr const char* note_and_view = R"(
CREATE TABLE note (
  run INTEGER NOT NULL,
  number INTEGER NOT NULL,  -- from 1, in the order of writing
  at_ns INTEGER,            -- CLOCK_MONOTONIC of the client
  message INTEGER,          -- sample.message
  kind TEXT NOT NULL,       -- for programs
  text TEXT NOT NULL,       -- for people
  cause TEXT,               -- JSON: why this message of a robot's own topic was late; NULL: another note
  PRIMARY KEY (run, number)
) WITHOUT ROWID;
CREATE VIEW message AS
SELECT sample.run, id, transport, repetition, message,
       CASE fate WHEN 0 THEN 'on time' WHEN 1 THEN 'late' WHEN 2 THEN 'lost' END AS fate, skipped_cycles,
       intended_ns / 1e9 AS intended_s,
       woke_after_ns / 1e3 AS wake_up_us,
       received_after_ns / 1e3 AS round_trip_us,
       (due_after_ns + woke_after_ns + sent_after_ns + received_after_ns) / 1e3 AS response_us,
       server_sent_after_ns / 1e3 AS server_us,
       passed_wake_ns / 1e3 AS passed_wake_us
FROM sample JOIN run ON run.number = sample.run;
)";

constexpr const char* trace = R"(
CREATE TABLE trace (
  run INTEGER NOT NULL,
  message INTEGER NOT NULL,  -- sample.message
  host TEXT NOT NULL,        -- of whose machine
  events TEXT NOT NULL,      -- JSON
  PRIMARY KEY (run, message, host)
);
)";

constexpr const char* is_of_this_format = "PRAGMA user_version = 4";

struct Table {
  const char* name;
  std::vector<std::string_view> key, others;
};

std::vector<Table> tables_of(std::int64_t version) {
  Table run{"run", {"number"}, {"started_at", "start_ns", "asked", "outcome"}};
  Table sample{"sample",
               {"run", "message"},
               {"intended_ns", "due_after_ns", "woke_after_ns", "sent_after_ns", "received_after_ns",
                "server_received_ns", "server_sent_after_ns", "skipped_cycles", "fate"}};
  if (version == 1) return {run, sample};
  run.others.push_back("key");
  sample.others.push_back("passed_wake_ns");
  Table note{"note", {"run", "number"}, {"at_ns", "message", "kind", "text"}};
  if (version == 2) return {run, sample, note};
  if (version > 3) note.others.push_back("cause");
  return {run, sample, note, {"trace", {"run", "message", "host"}, {"events"}}};
}

// Whether it keeps its rows by the key by which we read them (which no view does), and has these columns as
// stored ones, not as foreign expressions.
bool has(Connection& connection, const Table& table) {
  std::vector<std::string> key(table.key.size());
  std::set<std::string, std::less<>> others;
  Statement column(connection, "SELECT name, pk FROM pragma_table_xinfo(?) WHERE hidden = 0");
  column.bind(std::string(table.name));
  while (column.next()) {
    const auto place = static_cast<std::size_t>(column.integer(1));
    if (place > key.size()) return false;
    if (place > 0)
      key[place - 1] = column.text(0);
    else
      others.insert(column.text(0));
  }
  return std::ranges::equal(key, table.key) &&
         std::ranges::all_of(table.others, [&](std::string_view name) { return others.contains(name); });
}

}  // namespace

std::int64_t format_of(Connection& connection) {
  const auto application = connection.number("PRAGMA application_id");
  if (application == 0 && connection.number("SELECT count(*) FROM sqlite_schema") == 0) return 0;
  if (application != application_id)
    throw WrongFile(
        fmt::format("{}: it is another program's SQLite database, not a results file of ontime. Choose "
                    "another file.",
                    connection.name()));
  const auto version = connection.number("PRAGMA user_version");
  if (const bool newer = version > format_version; newer || version < 1)
    throw WrongFile(
        fmt::format("{}: it has format {}, {}; this ontime reads formats 1 to {}. {} another file.",
                    connection.name(), version, newer ? "from a newer ontime" : "which no ontime writes",
                    format_version, newer ? "Update ontime, or choose" : "Choose"));
  for (const auto& table : tables_of(version))
    if (!has(connection, table))
      throw WrongFile(fmt::format(
          "{}: its table `{}` does not match format {}: it is damaged, or another program changed it. "
          "Choose another file.",
          connection.name(), table.name, version));
  return version;
}

void create_tables(Connection& connection) {
  connection.run(run_and_sample);
  connection.run(note_and_view);
  connection.run(trace);
  connection.run(is_of_this_format);
}

void migrate_tables(Connection& connection, std::int64_t from) {
  if (from == 1) {
    connection.run(from_format_1);
    connection.run(note_and_view);
  } else {
    connection.run("ALTER TABLE note ADD COLUMN cause TEXT");
  }
  if (from < 3) connection.run(trace);
  connection.run(is_of_this_format);
}

}  // namespace ontime::record

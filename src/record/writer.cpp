// SPDX-License-Identifier: Apache-2.0
#include <chrono>
#include <filesystem>
#include <map>
#include <system_error>
#include <utility>

#include <fmt/chrono.h>
#include <fmt/format.h>

#include "record/connection.hpp"
#include "record/format.hpp"
#include "record/record.hpp"

namespace ontime::record {
namespace {

// Half of what a kill -9 may cost, so that a commit that takes its time is still within it.
constexpr std::chrono::milliseconds commit_interval{500};

std::string utc_now() {
  const auto now = std::chrono::floor<std::chrono::milliseconds>(std::chrono::system_clock::now());
  const auto seconds = std::chrono::floor<std::chrono::seconds>(now);
  return fmt::format("{:%Y-%m-%dT%H:%M:%S}.{:03}Z", seconds, (now - seconds).count());
}

std::string text_of(const nlohmann::json& value) {
  return value.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

// 0 says that there is no such time.
std::optional<std::int64_t> time_after(std::int64_t time, std::int64_t earlier) {
  if (time == 0) return std::nullopt;
  return difference(time, earlier);
}

}  // namespace

struct Writer::Database {
  explicit Database(std::shared_ptr<Connection> opened) : connection(std::move(opened)) {
    connection->has_format();  // looked at before anything is changed: it may be somebody else's
    if (sqlite3_db_readonly(connection->handle(), "main") == 1) connection->fail(SQLITE_READONLY);
    // Fails if another Writer has the file, or a killed one left it and somebody reads it.
    connection->run("PRAGMA journal_mode = DELETE");
    connection->run("BEGIN IMMEDIATE");
    if (!connection->has_format()) connection->run(schema);
    connection->run("COMMIT");
    // With the log synced only where it is copied into the file, a kill costs nothing that was committed, and
    // a power cut no more than the newest of it. Copying waits for the disk, for seconds if that is under
    // load: so it is done before a run, and in one only when the log has 16 MiB, which takes 10 minutes at
    // 100 Hz.
    connection->run("PRAGMA synchronous = NORMAL; PRAGMA journal_mode = WAL");
    connection->run("PRAGMA wal_autocheckpoint = 4096; BEGIN IMMEDIATE");
    insert.emplace(*connection, "INSERT INTO sample VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)");
  }

  ~Database() {
    insert.reset();
    connection->try_run("COMMIT");
    // Fails while somebody reads: then the next Writer clears away what lies beside the file.
    connection->try_run("PRAGMA journal_mode = DELETE");
  }

  Database(const Database&) = delete;
  Database& operator=(const Database&) = delete;

  // A transaction is open at all times, which keeps other Writers out and does not hinder readers.
  // One that fails is given up whole: SQLite may have given up a part of it.
  template <class Change>
  void change(Change change) {
    try {
      if (sqlite3_get_autocommit(connection->handle()) != 0) connection->run("BEGIN IMMEDIATE");
      change();
    } catch (const Error&) {
      connection->try_run("ROLLBACK");
      throw;
    }
  }

  void commit(const char* between = "") {
    change([&] {
      connection->run("COMMIT");
      connection->run(between);
      connection->run("BEGIN IMMEDIATE");
    });
    committed_at = std::chrono::steady_clock::now();
  }

  // A run starts with its first message: by the clock that its times are of, wherever the Writer is.
  std::int64_t start_of(std::int64_t run, const roundtrip::Sample& first) {
    auto& start = start_ns.at(run);
    if (!start) {
      change([&] {
        Statement(*connection, "UPDATE run SET start_ns = ? WHERE number = ?")
            .bind(first.intended_ns)
            .bind(run)
            .execute();
      });
      commit();
      start = first.intended_ns;
    }
    return *start;
  }

  void add(std::int64_t run, std::int64_t run_start_ns, const roundtrip::Sample& sample) {
    insert->bind(run)
        .bind(static_cast<std::int64_t>(sample.index))
        .bind(difference(sample.intended_ns, run_start_ns))
        .bind(difference(sample.due_ns, sample.intended_ns))
        .bind(difference(sample.woke_ns, sample.due_ns))
        .bind(difference(sample.sent_ns, sample.woke_ns))
        .bind(time_after(sample.received_ns, sample.sent_ns))
        .bind(time_after(sample.server_received_ns, 0))
        .bind(time_after(sample.server_sent_ns, sample.server_received_ns))
        .bind(std::int64_t{sample.skipped_cycles})
        .bind(static_cast<std::int64_t>(sample.fate))
        .execute();
  }

  std::shared_ptr<Connection> connection;
  std::optional<Statement> insert;
  std::map<std::int64_t, std::optional<std::int64_t>> start_ns;  // of each run that has not ended
  std::chrono::steady_clock::time_point committed_at = std::chrono::steady_clock::now();
};

Writer::Writer(const std::string& path) {
  std::error_code ignored;
  const bool is_new = !path.empty() && !std::filesystem::exists(path, ignored);
  if (!is_new && !path.empty() && !std::filesystem::is_regular_file(path, ignored))
    throw WrongFile(fmt::format("{}: it is there, but not a file. Choose another name.", path));
  try {
    database_ = std::make_shared<Database>(
        std::make_shared<Connection>(path, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE));
  } catch (const Error&) {
    if (is_new && std::filesystem::file_size(path, ignored) == 0) std::filesystem::remove(path, ignored);
    throw;
  }
}

Writer::~Writer() = default;
Writer::Writer(Writer&&) noexcept = default;
Writer& Writer::operator=(Writer&&) noexcept = default;

std::int64_t Writer::begin_run(const nlohmann::json& asked) {
  std::int64_t run = 0;
  database_->change([&] {
    Statement(*database_->connection, "INSERT INTO run (started_at, asked) VALUES (?, ?)")
        .bind(utc_now())
        .bind(text_of(asked))
        .execute();
    run = sqlite3_last_insert_rowid(database_->connection->handle());
  });
  database_->commit("PRAGMA wal_checkpoint");
  database_->start_ns[run] = std::nullopt;
  return run;
}

void Writer::append(std::int64_t run, std::span<const roundtrip::Sample> samples) {
  if (!database_->start_ns.contains(run))
    throw Error(fmt::format("{}: there is no run {} under way to add samples to.",
                            database_->connection->name(), run));
  if (samples.empty()) return;
  const auto start = database_->start_of(run, samples.front());
  database_->change([&] {
    for (const auto& sample : samples) database_->add(run, start, sample);
  });
  if (std::chrono::steady_clock::now() - database_->committed_at >= commit_interval) database_->commit();
}

void Writer::end_run(std::int64_t run, const nlohmann::json& outcome) {
  if (database_->start_ns.erase(run) == 0)
    throw Error(fmt::format("{}: there is no run {} under way to end.", database_->connection->name(), run));
  database_->change([&] {
    Statement(*database_->connection, "UPDATE run SET outcome = ? WHERE number = ?")
        .bind(text_of(outcome))
        .bind(run)
        .execute();
  });
  database_->commit();
}

void Writer::flush() { database_->commit(); }

Reader Writer::reader() { return Reader(database_->connection); }

}  // namespace ontime::record

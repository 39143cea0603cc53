// SPDX-License-Identifier: Apache-2.0
#include "record/database.hpp"

#include <algorithm>
#include <chrono>
#include <thread>

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <unistd.h>

#include "record/document.hpp"
#include "record/format.hpp"

namespace ontime::record {
namespace {

// 16 MiB, which takes ten minutes at 100 Hz.
constexpr int most_log_pages = 4096;

std::string utc_now() {
  const auto now = std::chrono::floor<std::chrono::milliseconds>(std::chrono::system_clock::now());
  const auto seconds = std::chrono::floor<std::chrono::seconds>(now);
  return fmt::format("{:%Y-%m-%dT%H:%M:%S}.{:03}Z", seconds, (now - seconds).count());
}

// 0 says that there is no such time.
std::optional<std::int64_t> time_after(std::int64_t time, std::int64_t earlier) {
  if (time == 0) return std::nullopt;
  return difference(time, earlier);
}

}  // namespace

bool is_at(const std::string& path, const struct stat& file) {
  struct stat there {};
  return ::lstat(path.c_str(), &there) == 0 && there.st_dev == file.st_dev && there.st_ino == file.st_ino;
}

// Two threads may use this connection: one adds, while the other has a Reader on it.
Database::Database(const std::string& path, const std::optional<struct stat>& made)
    : path_(path),
      made_(made),
      connection_(std::make_shared<Connection>(
          path, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_FULLMUTEX)),
      enough_log_pages_(most_log_pages) {
  format_of(*connection_);  // looked at before anything is changed: it may be another program's
  if (sqlite3_db_readonly(connection_->handle(), "main") == 1) connection_->fail(SQLITE_READONLY);
  // Fails if another Writer has the file, or a killed one left it and another process reads it.
  connection_->run("PRAGMA journal_mode = DELETE");
  connection_->run("BEGIN IMMEDIATE");
  if (format_of(*connection_) == 0) create_tables(*connection_);
  connection_->run("COMMIT");
  if (!path.empty()) ::stat(path.c_str(), &file_);
  // With the log synced only where it is copied into the file, a kill costs nothing that was committed, and a
  // power cut no more than the newest of it. Copying waits for the disk, for seconds if that is under load:
  // so it is done before a run, and in one only when the log has become long.
  connection_->run("PRAGMA synchronous = NORMAL; PRAGMA journal_mode = WAL; PRAGMA wal_autocheckpoint = 0");
  connection_->run("BEGIN IMMEDIATE");
  if (const auto format = format_of(*connection_); format < format_version) migrate(format);
  insert_.emplace(*connection_,
                  "INSERT OR REPLACE INTO sample (run, message, intended_ns, due_after_ns, woke_after_ns, "
                  "sent_after_ns, received_after_ns, server_received_ns, server_sent_after_ns, "
                  "skipped_cycles, fate, passed_wake_ns) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)");
  const auto keep_length = [](void* length, sqlite3*, const char*, int pages) {
    *static_cast<int*>(length) = pages;
    return SQLITE_OK;
  };
  sqlite3_wal_hook(connection_->handle(), keep_length, &log_pages_);
}

Database::~Database() {
  sqlite3_wal_hook(connection_->handle(), nullptr, nullptr);
  insert_.reset();
  connection_->try_run("COMMIT");
  // Where a reader stays, the next Writer clears away what lies beside the file.
  bool is_one_file = leave_one_file();
  for (int tries = has_moved() ? 0 : 20; !is_one_file && tries > 0; --tries) {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    is_one_file = leave_one_file();
  }
  if (made_ && is_one_file) try {
      remove_unused();
    } catch (const Error&) {  // another process has it
    }
  connection_->try_run("COMMIT");
}

bool Database::has_moved() const {
  struct stat there {};
  if (path_.empty()) return false;
  return ::stat(path_.c_str(), &there) != 0 || there.st_dev != file_.st_dev || there.st_ino != file_.st_ino;
}

// False while another process reads, as `ontime watch` does for a moment of each second.
bool Database::leave_one_file() {
  connection_->try_run("PRAGMA journal_mode = DELETE");
  try {
    Statement mode(*connection_, "PRAGMA journal_mode");
    return mode.next() && mode.text(0) == "delete";
  } catch (const Error&) {
    return false;
  }
}

// While no other process has it: another Writer that waits for it finds that it is gone. Not beside a log,
// whose names are a new file's as well.
void Database::remove_unused() {
  connection_->run("BEGIN EXCLUSIVE");
  if (Statement(*connection_, "SELECT 1 FROM run").next()) return;
  if (is_at(path_, *made_)) ::unlink(path_.c_str());
}

// In one transaction of the log: whatever stops it, the file is of one format or the other.
void Database::migrate(std::int64_t from) {
  const auto runs = Reader(connection_).runs();
  migrate_tables(*connection_, from);
  for (const auto& run : runs)
    Statement(*connection_, "UPDATE run SET key = ? WHERE number = ?")
        .bind(run.key)
        .bind(run.number)
        .execute();
  connection_->run("COMMIT; BEGIN IMMEDIATE");
}

// A transaction is open at all times, which keeps other Writers out and does not hinder readers.
template <class Change>
void Database::commit(Change change) {
  try {
    if (sqlite3_get_autocommit(connection_->handle()) != 0) connection_->run("BEGIN IMMEDIATE");
    change();
    connection_->run("COMMIT; BEGIN IMMEDIATE");
  } catch (...) {
    connection_->try_run("ROLLBACK");
    is_worst_stale_ = most_bytes_ > 0;
    throw;
  }
}

// Between two transactions: the log is begun anew by the first that finds all of it copied.
void Database::copy_log() {
  connection_->run("COMMIT");
  connection_->try_run("PRAGMA wal_checkpoint");  // where that fails, the log keeps it all
  connection_->run("BEGIN IMMEDIATE");
}

std::int64_t Database::begin_run(const std::string& asked, const std::string& key) {
  std::int64_t run = 0;
  commit([&] {
    Statement(*connection_, "INSERT INTO run (started_at, asked, key) VALUES (?, ?, ?)")
        .bind(utc_now())
        .bind(asked)
        .bind(key)
        .execute();
    run = sqlite3_last_insert_rowid(connection_->handle());
    open_runs_.insert(run);
    if (worst_) worst_->forget_old_runs(open_runs_);
  });
  copy_log();
  return run;
}

void Database::add(const Batch& batch) {
  std::map<std::int64_t, std::int64_t> starts;
  if (is_worst_stale_) {
    commit([&] { worst_.emplace(*connection_, most_bytes_); });
    is_worst_stale_ = false;
  }
  commit([&] {
    for (const auto& [run, pieces] : batch.samples) {
      const auto start_ns = starts[run] = start_of(run, pieces.front().front());
      for (const auto& piece : pieces)
        for (const auto& sample : piece) add(run, start_ns, sample);
    }
    for (const auto& [run, note] : batch.notes) add(run, note);
    for (const auto& [run, outcome] : batch.outcomes) set_outcome(run, outcome);
    if (!worst_)
      for (const auto& [run, trace] : batch.traces) add(run, trace);
  });
  starts_.merge(starts);
  if (worst_)
    for (const auto& one : batch.traces) {
      commit([&] { add(one.first, one.second); });
      if (log_pages_ >= enough_log_pages_) copy_log();
    }
  if (log_pages_ >= enough_log_pages_) copy_log();
}

void Database::set_outcome(std::int64_t run, const std::string& outcome) {
  Statement(*connection_, "UPDATE run SET outcome = ? WHERE number = ?").bind(outcome).bind(run).execute();
}

void Database::end_run(std::int64_t run, const std::string& outcome) {
  commit([&] { set_outcome(run, outcome); });
  starts_.erase(run);
  open_runs_.erase(run);
}

void Database::forget_run(std::int64_t run) {
  commit([&] { delete_run(*connection_, run); });
  starts_.erase(run);
  open_runs_.erase(run);
}

// The log lies beside the file: it is copied when it is a sixteenth of all, and one trace adds little more.
void Database::keep_worst(std::uint64_t bytes) {
  // Else each message that goes looks at all notes of its run.
  connection_->run("COMMIT");
  connection_->try_on_all("CREATE INDEX IF NOT EXISTS note_of_message ON note (run, message)");
  connection_->run("BEGIN IMMEDIATE");
  const auto page_bytes = connection_->number("PRAGMA page_size");
  enough_log_pages_ = static_cast<int>(
      std::clamp<std::int64_t>(static_cast<std::int64_t>(bytes / 16) / page_bytes, 16, most_log_pages));
  most_bytes_ = bytes / 4 * 3;
  commit([&] { worst_.emplace(*connection_, most_bytes_); });
  connection_->run(fmt::format("PRAGMA journal_size_limit = {}", enough_log_pages_ * page_bytes).c_str());
  copy_log();
  if (connection_->number("PRAGMA page_count") * page_bytes <= static_cast<std::int64_t>(bytes / 4 * 3))
    return;
  // Of a greater bound the file may have more free pages than are allowed now. Where this fails, as on a full
  // disk or while another process reads, it stays as long as it was.
  connection_->run("COMMIT");
  connection_->try_on_all("VACUUM");
  connection_->try_run("PRAGMA wal_checkpoint(TRUNCATE)");
  connection_->run("BEGIN IMMEDIATE");
}

bool Database::has_run(std::int64_t run) {
  return Statement(*connection_, "SELECT 1 FROM run WHERE number = ?").bind(run).next();
}

// A run starts with its first message: by the clock that its times are of, wherever the Writer is.
std::int64_t Database::start_of(std::int64_t run, const roundtrip::Sample& first) {
  if (const auto known = starts_.find(run); known != starts_.end()) return known->second;
  Statement(*connection_, "UPDATE run SET start_ns = ? WHERE number = ?")
      .bind(first.intended_ns)
      .bind(run)
      .execute();
  return first.intended_ns;
}

void Database::add(std::int64_t run, std::int64_t start_ns, const roundtrip::Sample& sample) {
  insert_->bind(run)
      .bind(static_cast<std::int64_t>(sample.index))
      .bind(difference(sample.intended_ns, start_ns))
      .bind(difference(sample.due_ns, sample.intended_ns))
      .bind(difference(sample.woke_ns, sample.due_ns))
      .bind(difference(sample.sent_ns, sample.woke_ns))
      .bind(time_after(sample.received_ns, sample.sent_ns))
      .bind(time_after(sample.server_received_ns, 0))
      .bind(time_after(sample.server_sent_ns, sample.server_received_ns))
      .bind(std::int64_t{sample.skipped_cycles})
      .bind(static_cast<std::int64_t>(sample.fate))
      .bind(sample.passed_wake_ns)
      .execute();
}

void Database::add(std::int64_t run, const Note& note) {
  std::optional<std::int64_t> message;
  if (note.message) message = static_cast<std::int64_t>(*note.message);
  Statement(*connection_,
            "INSERT INTO note (run, number, at_ns, message, kind, text, cause) VALUES (?1, "
            "(SELECT ifnull(max(number), 0) + 1 FROM note WHERE run = ?1), ?2, ?3, ?4, ?5, nullif(?6, ''))")
      .bind(run)
      .bind(note.at_ns)
      .bind(message)
      .bind(utf8_of(note.kind))
      .bind(utf8_of(note.text))
      .bind(note.cause ? text_of(to_json(*note.cause)) : "")
      .execute();
}

void Database::add(std::int64_t run, const Trace& trace) {
  const auto message = static_cast<std::int64_t>(trace.window.span.message);
  if (worst_ && worst_->is_too_good(run, message)) return;
  auto events = trace::to_json(trace.window);
  if (!trace.way.is_null()) events["way"] = trace.way;
  const auto text = text_of(events);
  if (worst_ && !worst_->make_room(run, message, text.size())) return;
  Statement(*connection_, "INSERT OR REPLACE INTO trace (run, message, host, events) VALUES (?, ?, ?, ?)")
      .bind(run)
      .bind(message)
      .bind(utf8_of(trace.host))
      .bind(text)
      .execute();
}

}  // namespace ontime::record

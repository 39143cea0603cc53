// SPDX-License-Identifier: Apache-2.0
// rosbag2's SQLite: a row of `topics` for each topic, one of `messages` for each message. The file may be
// hostile: no trigger or view of its schema runs, and each step ends.
#include <array>
#include <filesystem>
#include <map>

#include <fmt/format.h>
#include <sqlite3.h>

#include "bag/header.hpp"
#include "bag/reader.hpp"
#include "listen/listen.hpp"

namespace ontime::bag {
namespace {

constexpr int most_text_bytes = 4 << 20;  // of a value, except message data
constexpr int most_steps = 1'000'000;     // of SQLite's virtual machine, between two rows
constexpr std::size_t most_topics = 1 << 16;

// Absolute, because SQLite treats names such as ":memory:" specially.
std::string uri_of(const std::string& path, bool immutable) {
  std::string uri = "file:";
  for (const char c : std::filesystem::absolute(path).string()) {
    if (c == '%' || c == '?' || c == '#')
      uri += fmt::format("%{:02x}", c);
    else
      uri += c;
  }
  return immutable ? uri + "?immutable=1" : uri;
}

class Database {
 public:
  explicit Database(const std::string& path) : path_(path) {
    require_files_beside();
    open(false);
    // In a read-only folder without a log, the file can be read without a lock.
    if (const int code = run("SELECT 1 FROM sqlite_schema"); code != SQLITE_OK) {
      if (((code & 0xff) != SQLITE_CANTOPEN && (code & 0xff) != SQLITE_READONLY) || has_log()) fail(code);
      open(true);
    }
  }

  sqlite3* handle() { return handle_.get(); }
  const std::string& path() const { return path_; }
  void comes_on() { looks_ = 0; }
  int run(const char* sql) {
    comes_on();
    return sqlite3_exec(handle(), sql, nullptr, nullptr, nullptr);
  }

  [[noreturn]] void damaged(const std::string& what) const {
    throw listen::WrongInput(fmt::format("{}: damaged: {}. Try: sqlite3 FILE .recover", path_, what));
  }

  [[noreturn]] void fail(int code) {
    const std::string text = sqlite3_errmsg(handle());
    switch (code & 0xff) {
      case SQLITE_INTERRUPT:
        damaged("a query does not end");
      case SQLITE_CORRUPT:
      case SQLITE_NOTADB:
      case SQLITE_TOOBIG:
        damaged(text);
      case SQLITE_ERROR:
      case SQLITE_MISMATCH:
        throw listen::WrongInput(
            fmt::format("{}: not a bag: its tables are not those of rosbag2 ({})", path_, text));
      case SQLITE_CANTOPEN:
      case SQLITE_READONLY:
        if (has_log())
          throw listen::Error(fmt::format(
              "{}: its newest messages are in {}-wal, which cannot be read in a read-only folder. "
              "Fix: copy both files to a writable folder",
              path_, path_));
        [[fallthrough]];
      default:
        throw listen::Error(fmt::format("{}: cannot be read: {}", path_, text));
    }
  }

 private:
  void open(bool immutable) {
    sqlite3* handle = nullptr;
    const int code = sqlite3_open_v2(uri_of(path_, immutable).c_str(), &handle,
                                     SQLITE_OPEN_READONLY | SQLITE_OPEN_NOMUTEX | SQLITE_OPEN_URI, nullptr);
    handle_.reset(handle);
    if (code != SQLITE_OK) fail(code);
    sqlite3_busy_timeout(handle, 1000);
    sqlite3_db_config(handle, SQLITE_DBCONFIG_DEFENSIVE, 1, nullptr);
    sqlite3_db_config(handle, SQLITE_DBCONFIG_ENABLE_TRIGGER, 0, nullptr);
    sqlite3_db_config(handle, SQLITE_DBCONFIG_ENABLE_VIEW, 0, nullptr);
    sqlite3_db_config(handle, SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0, nullptr);
    sqlite3_progress_handler(handle, most_steps, look, this);
    run("PRAGMA cell_size_check = ON");
  }

  static int look(void* database) { return ++static_cast<Database*>(database)->looks_ > 1 ? 1 : 0; }

  bool has_log() const {
    std::error_code error;
    return std::filesystem::file_size(path_ + "-wal", error) > 0 && !error;
  }

  // SQLite opens files with these suffixes; opening a FIFO would wait for ever.
  void require_files_beside() const {
    std::error_code ignored;
    for (const auto* suffix : {"-wal", "-shm", "-journal"}) {
      const auto status = std::filesystem::symlink_status(path_ + suffix, ignored);
      if (std::filesystem::exists(status) && !std::filesystem::is_regular_file(status))
        throw listen::WrongInput(
            fmt::format("{}: {}{} is not a regular file. Fix: remove it", path_, path_, suffix));
    }
  }

  const std::string path_;
  int looks_ = 0;  // since the last row
  std::unique_ptr<sqlite3, decltype([](sqlite3* handle) { sqlite3_close(handle); })> handle_;
};

class Rows {
 public:
  Rows(Database& database, const char* sql) : database_(database) {
    sqlite3_stmt* handle = nullptr;
    const int code = sqlite3_prepare_v2(database.handle(), sql, -1, &handle, nullptr);
    handle_.reset(handle);
    if (code != SQLITE_OK) database.fail(code);
  }

  bool next() {
    database_.comes_on();
    const int code = sqlite3_step(handle_.get());
    if (code != SQLITE_ROW && code != SQLITE_DONE) database_.fail(code);
    return code == SQLITE_ROW;
  }

  std::int64_t integer(int column) {
    if (sqlite3_column_type(handle_.get(), column) != SQLITE_INTEGER) wrong_type(column);
    return sqlite3_column_int64(handle_.get(), column);
  }

  std::string text(int column) {
    if (sqlite3_column_type(handle_.get(), column) != SQLITE_TEXT) wrong_type(column);
    const auto* bytes = reinterpret_cast<const char*>(sqlite3_column_text(handle_.get(), column));
    const auto length = sqlite3_column_bytes(handle_.get(), column);
    if (bytes == nullptr || length > most_text_bytes)
      database_.damaged(fmt::format("a text of {} bytes (maximum: {})", length, most_text_bytes));
    return {bytes, static_cast<std::size_t>(length)};
  }

 private:
  [[noreturn]] void wrong_type(int column) {
    database_.damaged(
        fmt::format("a value of '{}' has an unexpected type", sqlite3_column_name(handle_.get(), column)));
  }
  Database& database_;
  std::unique_ptr<sqlite3_stmt, decltype([](sqlite3_stmt* handle) { sqlite3_finalize(handle); })> handle_;
};

// The first bytes of messages. The rest, which may be a whole picture, is not read.
class Beginnings {
 public:
  explicit Beginnings(Database& database) : database_(database) {}

  std::optional<std::int64_t> stamp_of(std::int64_t row) {
    std::array<std::byte, stamp_end> begin;
    if (!go_to(row) || sqlite3_blob_bytes(handle_.get()) < static_cast<int>(begin.size())) return {};
    if (const int code = sqlite3_blob_read(handle_.get(), begin.data(), begin.size(), 0); code != SQLITE_OK)
      database_.fail(code);
    return bag::stamp_of(begin);
  }

 private:
  // False: the value there is of another type.
  bool go_to(std::int64_t row) {
    database_.comes_on();
    int code = SQLITE_OK;
    if (handle_) {
      code = sqlite3_blob_reopen(handle_.get(), row);
    } else {
      sqlite3_blob* handle = nullptr;
      code = sqlite3_blob_open(database_.handle(), "main", "messages", "data", row, 0, &handle);
      handle_.reset(handle);
    }
    if (code == SQLITE_OK) return true;
    handle_.reset();
    if (code != SQLITE_ERROR) database_.fail(code);
    return false;
  }
  Database& database_;
  std::unique_ptr<sqlite3_blob, decltype([](sqlite3_blob* handle) { sqlite3_blob_close(handle); })> handle_;
};

class Sqlite final : public Reader {
 public:
  explicit Sqlite(const std::string& path) : database_(path) {
    const auto definitions = definitions_of();
    Rows rows(database_, "SELECT id, name, type, serialization_format FROM topics");
    while (rows.next()) {
      auto name = rows.text(1);
      const auto type = rows.text(2);
      const auto found = definitions.find(type);
      const bool has_header = found == definitions.end() ? begins_with_header(type, "", "") : found->second;
      if (name.size() > longest_name || topics_.size() == most_topics)
        database_.damaged(fmt::format("more than {} topics, or a topic name of more than {} bytes",
                                      most_topics, longest_name));
      topics_[rows.integer(0)] = {std::move(name), 0, rows.text(3) == "cdr" && has_header};
    }
    messages_.emplace(database_, "SELECT rowid, topic_id, timestamp FROM messages ORDER BY rowid");
  }

  std::optional<Message> next() override {
    if (!messages_->next()) return {};
    const auto row = messages_->integer(0);
    if (row < next_row_) database_.damaged(fmt::format("message {} is out of order", row));
    next_row_ = row == INT64_MAX ? row : row + 1;
    const auto topic = topics_.find(messages_->integer(1));
    if (topic == topics_.end()) database_.damaged(fmt::format("message {} has no topic", row));
    const auto at_ns = messages_->integer(2);
    if (at_ns < 0 || at_ns > latest_ns)
      database_.damaged(fmt::format("message {} has the invalid time {} ns", row, at_ns));
    Message message{.topic = &topic->second, .recorded_ns = at_ns};
    if (message.topic->has_header) message.stamp_ns = beginnings_.stamp_of(row);
    return message;
  }

 private:
  // By type, whether it begins with a Header. Older bags have no such table.
  std::map<std::string, bool> definitions_of() {
    std::map<std::string, bool> definitions;
    Rows table(database_,
               "SELECT 1 FROM sqlite_schema WHERE type = 'table' AND name = 'message_definitions'");
    if (!table.next()) return definitions;
    Rows rows(database_, "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions");
    while (definitions.size() < most_topics && rows.next()) {
      const auto type = rows.text(0);
      definitions[type] = begins_with_header(type, rows.text(1), rows.text(2));
    }
    return definitions;
  }

  Database database_;
  std::map<std::int64_t, Topic> topics_;
  std::optional<Rows> messages_;
  Beginnings beginnings_{database_};
  std::int64_t next_row_ = INT64_MIN;
};

}  // namespace

std::unique_ptr<Reader> read_sqlite(const std::string& path) { return std::make_unique<Sqlite>(path); }

}  // namespace ontime::bag

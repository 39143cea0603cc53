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
#include "record/connection.hpp"

namespace ontime::bag {
namespace {

constexpr std::size_t most_text_bytes = 4 << 20;  // of a value, except message data
constexpr std::size_t most_topics = 1 << 16;

class Database final : public record::Connection {
 public:
  explicit Database(const std::string& path) : Connection(path) {
    open_file(false);
    // In a read-only folder without a log, the file can be read without a lock.
    if (const int code = try_run("SELECT 1 FROM sqlite_schema"); code != SQLITE_OK) {
      if (((code & 0xff) != SQLITE_CANTOPEN && (code & 0xff) != SQLITE_READONLY) || has_log()) fail(code);
      open_file(true);
    }
  }

  [[noreturn]] void damaged(const std::string& what) const {
    throw listen::WrongInput(fmt::format("{}: damaged: {}. Try: sqlite3 FILE .recover", name(), what));
  }

  [[noreturn]] void fail(int code) override {
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
            fmt::format("{}: not a bag: its tables are not those of rosbag2 ({})", name(), text));
      case SQLITE_CANTOPEN:
      case SQLITE_READONLY:
        if (has_log())
          throw listen::Error(
              fmt::format("{}: its newest messages are in {}, which cannot be read in a read-only folder. "
                          "Fix: copy both files to a writable folder",
                          name(), beside("-wal")));
        [[fallthrough]];
      default:
        throw listen::Error(fmt::format("{}: cannot be read: {}", name(), text));
    }
  }

  [[noreturn]] void fail_type(const char* column, const char*) override {
    damaged(fmt::format("a value of '{}' has an unexpected type", column));
  }

  [[noreturn]] void fail_beside(const std::string& path) override {
    throw listen::WrongInput(fmt::format("{}: {} is not a regular file. Fix: remove it", name(), path));
  }

 private:
  void open_file(bool immutable) {
    open(SQLITE_OPEN_READONLY | SQLITE_OPEN_NOMUTEX, immutable);
    sqlite3_db_config(handle(), SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0, nullptr);
  }

  bool has_log() const {
    std::error_code error;
    return std::filesystem::file_size(beside("-wal"), error) > 0 && !error;
  }
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
    database_.came_on();
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
    record::Statement rows(database_, "SELECT id, name, type, serialization_format FROM topics");
    while (rows.next()) {
      auto name = text_of(rows, 1);
      const auto type = text_of(rows, 2);
      const auto found = definitions.find(type);
      const bool has_header = found == definitions.end() ? begins_with_header(type, "", "") : found->second;
      if (name.size() > longest_name || topics_.size() == most_topics)
        database_.damaged(fmt::format("more than {} topics, or a topic name of more than {} bytes",
                                      most_topics, longest_name));
      topics_[rows.integer(0)] = {std::move(name), 0, text_of(rows, 3) == "cdr" && has_header};
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
  std::string text_of(record::Statement& rows, int column) {
    const auto text = rows.optional_text(column);
    if (!text) database_.fail_type(rows.name(column), "text");
    if (text->size() > most_text_bytes)
      database_.damaged(fmt::format("a text of {} bytes (maximum: {})", text->size(), most_text_bytes));
    return std::string(*text);
  }

  // By type, whether it begins with a Header. Older bags have no such table.
  std::map<std::string, bool> definitions_of() {
    std::map<std::string, bool> definitions;
    record::Statement table(
        database_, "SELECT 1 FROM sqlite_schema WHERE type = 'table' AND name = 'message_definitions'");
    if (!table.next()) return definitions;
    record::Statement rows(
        database_, "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions");
    while (definitions.size() < most_topics && rows.next()) {
      const auto type = text_of(rows, 0);
      definitions[type] = begins_with_header(type, text_of(rows, 1), text_of(rows, 2));
    }
    return definitions;
  }

  Database database_;
  std::map<std::int64_t, Topic> topics_;
  std::optional<record::Statement> messages_;
  Beginnings beginnings_{database_};
  std::int64_t next_row_ = INT64_MIN;
};

}  // namespace

std::unique_ptr<Reader> read_sqlite(const std::string& path) { return std::make_unique<Sqlite>(path); }

}  // namespace ontime::bag

// SPDX-License-Identifier: Apache-2.0
// SQLite, as Writer and Reader use it, and the reader of bags: a connection and its statements, with errors
// for users. The file may be foreign and hostile: no trigger or view that is in it is used, no value is taken
// for another type than it has, and no step runs forever.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include <sqlite3.h>

namespace ontime::record {

class Connection {
 public:
  // An empty path: a temporary database. `flags` are of sqlite3_open_v2; `immutable` says that no process
  // writes.
  Connection(const std::string& path, int flags, bool immutable = false);
  virtual ~Connection() = default;
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  void run(const char* sql);
  int try_run(const char* sql) noexcept;  // SQLite's code
  int try_on_all(const char* sql);        // for what looks at each row: may take as long as the file is large
  std::int64_t number(const char* sql);   // the first column of the first row
  // Throw what SQLite's code means, that a value has not the expected type, or that what lies beside the file
  // is none, for people: here Error of a results file. Another kind of file has its own words.
  [[noreturn]] virtual void fail(int code);
  [[noreturn]] virtual void fail_type(const char* column, const char* expected);
  [[noreturn]] virtual void fail_beside(const std::string& path);

  const std::string& name() const { return name_; }  // the path, as people gave it
  std::string beside(const char* suffix) const;      // the path of SQLite's "-wal", and so on
  sqlite3* handle() { return handle_.get(); }
  void came_on() noexcept { looks_.store(0, std::memory_order_relaxed); }  // before each step

 protected:
  explicit Connection(const std::string& path);  // not open yet
  void open(int flags, bool immutable);          // or opens it anew

 private:
  static int look(void* connection);  // at whether it comes on

  struct Close {
    void operator()(sqlite3* handle) const { sqlite3_close(handle); }
  };
  const std::string path_;  // empty: a temporary file
  std::string name_;
  std::atomic<int> looks_ = 0;  // since the last row, or the last statement
  std::unique_ptr<sqlite3, Close> handle_;
};

class Statement {
 public:
  Statement(Connection&, const char* sql);  // the connection must outlive it

  // Parameters in their order. Nothing: NULL.
  Statement& bind(std::int64_t);
  Statement& bind(const std::optional<std::int64_t>&);
  Statement& bind(const std::string&);
  void execute();  // and is then ready to be bound again
  bool next();     // whether there is a row

  std::int64_t integer(int column);
  std::optional<std::int64_t> optional_integer(int column);
  std::optional<std::string_view> optional_text(int column);  // until next()
  std::string text(int column);                               // empty for NULL
  const char* name(int column) { return sqlite3_column_name(handle_.get(), column); }

 private:
  void check(int code);
  struct Finalize {
    void operator()(sqlite3_stmt* handle) const { sqlite3_finalize(handle); }
  };
  Connection& connection_;
  std::unique_ptr<sqlite3_stmt, Finalize> handle_;
  int bound_ = 0;
};

}  // namespace ontime::record

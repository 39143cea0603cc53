// SPDX-License-Identifier: Apache-2.0
// SQLite, as Writer and Reader use it: a connection and its statements, with errors for users.
// The file may be foreign and hostile: no trigger or view that is in it is used, no value is
// taken for another type than it has, and no step runs forever.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include <sqlite3.h>

namespace ontime::record {

class Connection {
 public:
  // An empty path: a temporary database. `flags` are of sqlite3_open_v2; `immutable` says that no process
  // writes.
  Connection(const std::string& path, int flags, bool immutable = false);
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  void run(const char* sql);
  void try_run(const char* sql) noexcept;
  std::int64_t number(const char* sql);  // the first column of the first row
  [[noreturn]] void fail(int code);      // throws Error: what SQLite's code means, for people

  const std::string& name() const { return name_; }  // the path, as people gave it
  sqlite3* handle() { return handle_.get(); }

 private:
  friend class Statement;
  static int look(void* connection);  // at whether it comes on
  void came_on() noexcept { looks_.store(0, std::memory_order_relaxed); }

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
  std::string text(int column);  // empty for NULL

 private:
  void check(int code);
  [[noreturn]] void fail_type(int column, const char* expected);
  struct Finalize {
    void operator()(sqlite3_stmt* handle) const { sqlite3_finalize(handle); }
  };
  Connection& connection_;
  std::unique_ptr<sqlite3_stmt, Finalize> handle_;
  int bound_ = 0;
};

}  // namespace ontime::record

// SPDX-License-Identifier: Apache-2.0
#include "record/connection.hpp"

#include <cerrno>
#include <filesystem>
#include <system_error>

#include <fmt/format.h>

#include "record/format.hpp"
#include "record/record.hpp"

namespace ontime::record {
namespace {

std::string reason(sqlite3* handle) {
  const int error = sqlite3_system_errno(handle);
  return error != 0 ? std::generic_category().message(error) : sqlite3_errmsg(handle);
}

std::string explanation(int code, sqlite3* handle) {
  switch (code & 0xff) {  // the rest tells kinds of each apart
    case SQLITE_FULL:
      return "the disk is full. What was committed before is in the file: make room, or choose a file "
             "elsewhere.";
    case SQLITE_READONLY:
    case SQLITE_PERM:
      return "it is read-only. Choose another file, or permit writing to it and to its folder.";
    case SQLITE_BUSY:
      return "another program uses it. Wait until that has ended, or choose another file.";
    case SQLITE_NOTADB:
      return "it is not a results file of ontime (not an SQLite database). Choose another file.";
    case SQLITE_CORRUPT:
      return fmt::format("it is damaged ({}). `sqlite3 FILE .recover` may save what is left.",
                         reason(handle));
    case SQLITE_CANTOPEN:
      return fmt::format(
          "it, or its -wal file beside it, cannot be opened ({}). Choose another file, or see to its "
          "folder and the permissions there.",
          reason(handle));
    case SQLITE_IOERR:
      return fmt::format(
          "reading or writing failed ({}). What was committed before is in the file: see to the "
          "disk, or choose a file elsewhere.",
          reason(handle));
    default:
      return fmt::format("SQLite says: {}.", sqlite3_errmsg(handle));
  }
}

// Absolute, so that no path means something else to SQLite, as ":memory:" does.
std::string uri_of(const std::string& path, bool immutable) {
  if (path.empty()) return path;
  std::string uri = "file:";
  for (const char c : std::filesystem::absolute(path).string()) {
    if (c == '%' || c == '?' || c == '#')
      uri += fmt::format("%{:02x}", c);
    else
      uri += c;
  }
  return immutable ? uri + "?immutable=1" : uri;
}

}  // namespace

Connection::Connection(const std::string& path, int flags, bool immutable)
    : name_(path.empty() ? "temporary results file (in $TMPDIR or /var/tmp)" : path) {
  sqlite3* handle = nullptr;
  const int code =
      sqlite3_open_v2(uri_of(path, immutable).c_str(), &handle, flags | SQLITE_OPEN_URI, nullptr);
  handle_.reset(handle);
  if (code != SQLITE_OK) fail(code);
  sqlite3_extended_result_codes(handle, 1);
  sqlite3_busy_timeout(handle, 1000);
}

void Connection::run(const char* sql) {
  const int code = sqlite3_exec(handle(), sql, nullptr, nullptr, nullptr);
  if (code != SQLITE_OK) fail(code);
}

void Connection::try_run(const char* sql) noexcept { sqlite3_exec(handle(), sql, nullptr, nullptr, nullptr); }

std::int64_t Connection::number(const char* sql) {
  Statement statement(*this, sql);
  statement.next();
  return statement.integer(0);
}

bool Connection::has_format() {
  const auto application = number("PRAGMA application_id");
  if (application == 0 && number("SELECT count(*) FROM sqlite_master") == 0) return false;
  if (application != application_id)
    throw WrongFile(
        fmt::format("{}: it is not a results file of ontime, but another program's SQLite database. Choose "
                    "another file.",
                    name_));
  const auto version = number("PRAGMA user_version");
  if (version > format_version)
    throw WrongFile(
        fmt::format("{}: it has format {}, from a newer ontime; this one knows format {}. Update ontime, or "
                    "choose another file.",
                    name_, version, format_version));
  return true;
}

void Connection::fail(int code) {
  const auto text = fmt::format("{}: {}", name_, explanation(code, handle_.get()));
  const int kind = code & 0xff;
  if (kind == SQLITE_NOTADB || kind == SQLITE_CORRUPT) throw WrongFile(text);
  throw Error(text);
}

Statement::Statement(Connection& connection, const char* sql) : connection_(connection) {
  sqlite3_stmt* handle = nullptr;
  const int code = sqlite3_prepare_v2(connection_.handle(), sql, -1, &handle, nullptr);
  handle_.reset(handle);
  check(code);
}

Statement& Statement::bind(std::int64_t value) {
  check(sqlite3_bind_int64(handle_.get(), ++bound_, value));
  return *this;
}

Statement& Statement::bind(const std::optional<std::int64_t>& value) {
  if (value) return bind(*value);
  check(sqlite3_bind_null(handle_.get(), ++bound_));
  return *this;
}

Statement& Statement::bind(const std::string& value) {
  check(sqlite3_bind_text64(handle_.get(), ++bound_, value.data(), value.size(), SQLITE_TRANSIENT,
                            SQLITE_UTF8));
  return *this;
}

void Statement::execute() {
  sqlite3_step(handle_.get());
  bound_ = 0;
  check(sqlite3_reset(handle_.get()));  // says again what the step said
}

bool Statement::next() {
  const int code = sqlite3_step(handle_.get());
  if (code != SQLITE_DONE && code != SQLITE_ROW) connection_.fail(code);
  return code == SQLITE_ROW;
}

std::int64_t Statement::integer(int column) { return sqlite3_column_int64(handle_.get(), column); }

std::optional<std::int64_t> Statement::optional_integer(int column) {
  if (sqlite3_column_type(handle_.get(), column) == SQLITE_NULL) return std::nullopt;
  return integer(column);
}

std::string Statement::text(int column) {
  const auto* bytes = reinterpret_cast<const char*>(sqlite3_column_text(handle_.get(), column));
  const auto size = static_cast<std::size_t>(sqlite3_column_bytes(handle_.get(), column));
  return bytes == nullptr ? std::string() : std::string(bytes, size);
}

void Statement::check(int code) {
  if (code != SQLITE_OK) connection_.fail(code);
}

}  // namespace ontime::record

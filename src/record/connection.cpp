// SPDX-License-Identifier: Apache-2.0
#include "record/connection.hpp"

#include <algorithm>
#include <cerrno>
#include <climits>
#include <filesystem>
#include <system_error>
#include <utility>

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include "record/document.hpp"
#include "record/record.hpp"

namespace ontime::record {
namespace {

constexpr int usual_steps = 1'000'000;

// It may name what is in the file, in foreign letters.
std::string message_of(sqlite3* handle) {
  std::string text = sqlite3_errmsg(handle);
  std::replace_if(
      text.begin(), text.end(), [](unsigned char c) { return c < ' ' || c > '~'; }, '?');
  return text;
}

std::string reason(sqlite3* handle) {
  const int error = sqlite3_system_errno(handle);
  return error != 0 ? std::generic_category().message(error) : message_of(handle);
}

// SQLite tries again to read what it could not open to write, and has forgotten then why.
std::string why_not_opened(const std::string& path, sqlite3* handle) {
  if (path.empty()) return reason(handle);
  const auto file = std::filesystem::absolute(path), folder = file.parent_path();
  // A folder that can only be read has no place for the files beside; but first, the file must be readable.
  for (const auto& [one, wanted] :
       {std::pair(folder, X_OK), std::pair(file, R_OK), std::pair(folder, W_OK | X_OK)})
    if (faccessat(AT_FDCWD, one.c_str(), wanted, AT_EACCESS) != 0 && (one == folder || errno != ENOENT))
      return fmt::format("{}: {}", one.string(), std::generic_category().message(errno));
  return reason(handle);
}

std::string explanation(const std::string& path, int code, sqlite3* handle) {
  std::error_code none;
  const auto size = std::filesystem::file_size(path, none);
  const bool is_new = none ? none == std::errc::no_such_file_or_directory && !path.empty() : size == 0;
  const auto* const earlier = is_new ? "" : " Earlier data are in the file.";
  if (code == SQLITE_READONLY_DBMOVED)
    return "it was removed or renamed meanwhile. Try again, or choose another file.";
  switch (code & 0xff) {  // the rest tells kinds of each apart
    case SQLITE_FULL:
      return fmt::format("the disk is full.{} Free space, or choose a file elsewhere.", earlier);
    case SQLITE_READONLY:
    case SQLITE_PERM:
      return "it is read-only. Choose another file, or make it and its folder writable.";
    case SQLITE_BUSY:
      return "another program uses it. Wait until that program ends, or choose another file.";
    case SQLITE_NOTADB:
      return "it is not a results file of ontime (not an SQLite database). Choose another file.";
    case SQLITE_CORRUPT:
      return fmt::format("it is damaged ({}). `sqlite3 FILE .recover` may save what is left.",
                         reason(handle));
    case SQLITE_CANTOPEN:
      return fmt::format(
          "it or its -wal file cannot be opened ({}). Check its folder and permissions, or choose another "
          "file.",
          why_not_opened(path, handle));
    case SQLITE_IOERR:
      return fmt::format("reading or writing failed ({}).{} Check the disk, or choose a file elsewhere.",
                         reason(handle), earlier);
    case SQLITE_INTERRUPT:
      return "it is damaged (reading it would never end).";
    case SQLITE_ERROR:  // of our SQL, which nothing else can be wrong with
    case SQLITE_CONSTRAINT:
    case SQLITE_MISMATCH:
    case SQLITE_TOOBIG:
      return fmt::format(
          "its tables are invalid ({}): it is damaged, or another program changed it. Choose another file.",
          message_of(handle));
    default:
      return fmt::format("SQLite says: {}.", message_of(handle));
  }
}

// Absolute, because paths such as ":memory:" are special to SQLite; and with links resolved, because it is
// opened with SQLITE_OPEN_NOFOLLOW, so that a link that appears meanwhile is not followed.
std::string uri_of(const std::string& path, bool immutable) {
  if (path.empty()) return path;
  std::string uri = "file:";
  std::error_code ignored;  // of what cannot be resolved SQLite says why
  const auto real = std::filesystem::weakly_canonical(std::filesystem::absolute(path), ignored);
  for (const char c : (ignored ? std::filesystem::absolute(path) : real).string()) {
    if (c == '%' || c == '?' || c == '#')
      uri += fmt::format("%{:02x}", c);
    else
      uri += c;
  }
  return immutable ? uri + "?immutable=1" : uri;
}

}  // namespace

Connection::Connection(const std::string& path)
    : path_(path), name_(path.empty() ? "temporary results file (in $TMPDIR or /var/tmp)" : path) {}

Connection::Connection(const std::string& path, int flags, bool immutable) : Connection(path) {
  open(flags, immutable);
  sqlite3_limit(handle(), SQLITE_LIMIT_LENGTH, 3 * longest_text);  // a row has two
  // Not SQLITE_DBCONFIG_TRUSTED_SCHEMA: to SQLite 3.40 the json_extract() of our own tables is not to be
  // trusted.
}

std::string Connection::beside(const char* suffix) const {
  std::error_code ignored;
  return std::filesystem::weakly_canonical(path_, ignored).string() + suffix;
}

void Connection::open(int flags, bool immutable) {
  // SQLite opens what lies beside a file by its name; opening a FIFO would wait for ever.
  if (!path_.empty())
    for (const auto* suffix : {"-wal", "-shm", "-journal"}) {
      std::error_code ignored;
      const auto status = std::filesystem::symlink_status(beside(suffix), ignored);
      if (exists(status) && !is_regular_file(status)) fail_beside(beside(suffix));
    }
  sqlite3* handle = nullptr;
  const int code = sqlite3_open_v2(uri_of(path_, immutable).c_str(), &handle,
                                   flags | SQLITE_OPEN_URI | SQLITE_OPEN_NOFOLLOW, nullptr);
  handle_.reset(handle);
  if (code != SQLITE_OK) fail(code);
  sqlite3_extended_result_codes(handle, 1);
  sqlite3_busy_timeout(handle, 1000);
  sqlite3_db_config(handle, SQLITE_DBCONFIG_DEFENSIVE, 1, nullptr);
  sqlite3_db_config(handle, SQLITE_DBCONFIG_ENABLE_TRIGGER, 0, nullptr);
  sqlite3_db_config(handle, SQLITE_DBCONFIG_ENABLE_VIEW, 0, nullptr);
  sqlite3_progress_handler(handle, usual_steps, look, this);
  run("PRAGMA cell_size_check = ON");
}

// Between two rows there are some dozens of SQLite's instructions. More than this: it never ends.
int Connection::look(void* connection) { return ++static_cast<Connection*>(connection)->looks_ > 1 ? 1 : 0; }

int Connection::try_on_all(const char* sql) {
  constexpr std::int64_t steps_a_page = 4000;  // at most, with some dozens of a row
  const auto steps = number("PRAGMA page_count") * steps_a_page + usual_steps;
  sqlite3_progress_handler(handle(), static_cast<int>(std::min<std::int64_t>(steps, INT_MAX)), look, this);
  const int code = try_run(sql);
  sqlite3_progress_handler(handle(), usual_steps, look, this);
  return code;
}

void Connection::run(const char* sql) {
  if (const int code = try_run(sql); code != SQLITE_OK) fail(code);
}

int Connection::try_run(const char* sql) noexcept {
  came_on();
  return sqlite3_exec(handle(), sql, nullptr, nullptr, nullptr);
}

std::int64_t Connection::number(const char* sql) {
  Statement statement(*this, sql);
  statement.next();
  return statement.integer(0);
}

void Connection::fail(int code) {
  const auto text = fmt::format("{}: {}", name_, explanation(path_, code, handle_.get()));
  constexpr int of_the_file[] = {SQLITE_NOTADB,     SQLITE_CORRUPT,  SQLITE_INTERRUPT, SQLITE_ERROR,
                                 SQLITE_CONSTRAINT, SQLITE_MISMATCH, SQLITE_TOOBIG};
  if (std::ranges::find(of_the_file, code & 0xff) != std::end(of_the_file)) throw WrongFile(text);
  throw Error(text);
}

void Connection::fail_type(const char* column, const char* expected) {
  throw WrongFile(fmt::format("{}: it is damaged (a value of {} is not a {}).", name_, column, expected));
}

void Connection::fail_beside(const std::string& path) {
  throw WrongFile(
      fmt::format("{}: {} is not a file. Check where it comes from, and remove it.", name_, path));
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
  connection_.came_on();
  sqlite3_step(handle_.get());
  bound_ = 0;
  check(sqlite3_reset(handle_.get()));  // says again what the step said
}

bool Statement::next() {
  connection_.came_on();
  const int code = sqlite3_step(handle_.get());
  if (code != SQLITE_DONE && code != SQLITE_ROW) connection_.fail(code);
  return code == SQLITE_ROW;
}

std::int64_t Statement::integer(int column) {
  const auto value = optional_integer(column);
  if (!value) connection_.fail_type(name(column), "whole number");
  return *value;
}

// One call for a value's type and the value. What it returns is for one thread at a time, as a Statement is.
std::optional<std::int64_t> Statement::optional_integer(int column) {
  auto* value = sqlite3_column_value(handle_.get(), column);
  const int type = sqlite3_value_type(value);
  if (type == SQLITE_NULL) return std::nullopt;
  if (type != SQLITE_INTEGER) connection_.fail_type(name(column), "whole number");
  return sqlite3_value_int64(value);
}

std::string Statement::text(int column) { return std::string(optional_text(column).value_or("")); }

std::optional<std::string_view> Statement::optional_text(int column) {
  const int type = sqlite3_column_type(handle_.get(), column);
  if (type == SQLITE_NULL) return std::nullopt;
  if (type != SQLITE_TEXT) connection_.fail_type(name(column), "text");
  const auto* bytes = reinterpret_cast<const char*>(sqlite3_column_text(handle_.get(), column));
  if (bytes == nullptr) connection_.fail(SQLITE_NOMEM);
  return std::string_view(bytes, static_cast<std::size_t>(sqlite3_column_bytes(handle_.get(), column)));
}

void Statement::check(int code) {
  if (code != SQLITE_OK) connection_.fail(code);
}

}  // namespace ontime::record

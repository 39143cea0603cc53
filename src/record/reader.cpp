// SPDX-License-Identifier: Apache-2.0
#include <filesystem>
#include <limits>
#include <optional>
#include <system_error>
#include <utility>

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include "record/connection.hpp"
#include "record/document.hpp"
#include "record/format.hpp"
#include "record/record.hpp"

namespace ontime::record {
namespace {

void require_file(const std::string& path) {
  std::error_code error;
  if (std::filesystem::is_regular_file(path, error)) return;
  throw WrongFile(fmt::format("{}: {}. Name a results file: `ontime run` and --results write one.", path,
                              error ? error.message() : "it is not a file"));
}

// A killed Writer may leave committed data in the log (-wal) beside the file. SQLite locks that log while
// reading, with another file (-shm). In a read-only folder it cannot create that file: no process writes
// there, and the log cannot be read. Without a log, a write that was cut off leaves a -journal, which only a
// process that may write can roll back.
std::shared_ptr<Connection> connect(const std::string& path) {
  require_file(path);
  auto connection = std::make_shared<Connection>(path, SQLITE_OPEN_READONLY | SQLITE_OPEN_NOMUTEX);
  try {
    format_of(*connection);
    return connection;
  } catch (const Error&) {
    const int code = sqlite3_errcode(connection->handle()) & 0xff;
    if (code != SQLITE_CANTOPEN && code != SQLITE_READONLY) throw;
    const auto holds_something = [](const std::string& file) {
      std::error_code ignored;
      return std::filesystem::exists(file, ignored) && std::filesystem::file_size(file, ignored) > 0;
    };
    if (const auto log = connection->beside("-wal"); holds_something(log))
      throw Error(
          fmt::format("{}: its newest samples are in {}, which cannot be read in a read-only folder. Copy "
                      "both files to a writable folder, and read them there.",
                      path, log));
    if (const auto journal = connection->beside("-journal"); holds_something(journal))
      throw Error(fmt::format(
          "{}: a write was cut off and must be rolled back first ({}). Fix: `sqlite3 FILE .tables`.", path,
          journal));
    return std::make_shared<Connection>(path, SQLITE_OPEN_READONLY | SQLITE_OPEN_NOMUTEX, true);
  }
}

[[noreturn]] void damaged(const Connection& connection, const std::string& how) {
  throw WrongFile(fmt::format("{}: it is damaged ({}).", connection.name(), how));
}

// Nothing, if it is missing, or if a late message cannot have it.
std::optional<LateCause> cause_of(const nlohmann::json& from) {
  auto cause = read<LateCause>(from);
  if (cause.sentence.empty() || cause.value_ns == 0) return std::nullopt;
  for (const auto value : {cause.value_ns, cause.limit_ns, cause.ns, cause.cpu.value_or(0)})
    if (value < 0 || !can_be(value)) return std::nullopt;
  return cause;
}

// Rows come in ascending order of their number. In a damaged file, or one made for that, they may go round
// for ever.
class Ascending {
 public:
  Ascending(const Connection& connection, const char* what, std::int64_t least)
      : connection_(connection), what_(what), next_(least) {}
  std::int64_t operator()(std::int64_t number) {
    if (number < next_ || number == std::numeric_limits<std::int64_t>::max())
      damaged(connection_, fmt::format("{} {} is out of order", what_, number));
    next_ = number + 1;
    return number;
  }

 private:
  const Connection& connection_;
  const char* what_;
  std::int64_t next_;
};

// All texts of a file together are no longer than the file, unless many rows claim the same bytes of it.
class Texts {
 public:
  explicit Texts(Connection& connection) : connection_(connection) {}
  std::string operator()(Statement& row, int column) {
    // Asked for only now, so that it is of the moment that the row is of.
    if (!left_) left_ = connection_.number("PRAGMA page_count") * connection_.number("PRAGMA page_size");
    auto text = row.text(column);
    *left_ -= static_cast<std::int64_t>(text.size());
    if (*left_ < 0) damaged(connection_, "its texts are longer than the whole file");
    return text;
  }

 private:
  Connection& connection_;
  std::optional<std::int64_t> left_;
};

nlohmann::json parsed(const Connection& connection, std::int64_t run, const std::string& text) {
  if (text.empty()) return nullptr;
  if (auto value = json_of(text)) return *std::move(value);
  damaged(connection, fmt::format("run {} is not JSON", run));
}

// Before the first message is sent it has no start_ns. As long as it is there, all that is read is of one
// moment.
Statement row_of(Connection& connection, std::int64_t run) {
  Statement row(connection, "SELECT start_ns FROM run WHERE number = ?");
  if (!row.bind(run).next()) throw Error(fmt::format("{}: it has no run {}.", connection.name(), run));
  return row;
}

// In the order of the columns that each_sample() names.
roundtrip::Sample sample_of(Statement& row, std::int64_t index, std::int64_t start_ns,
                            const Connection& connection) {
  roundtrip::Sample sample{};
  sample.index = static_cast<std::uint64_t>(index);
  sample.intended_ns = sum(start_ns, row.integer(1));
  sample.due_ns = sum(sample.intended_ns, row.integer(2));
  sample.woke_ns = sum(sample.due_ns, row.integer(3));
  sample.sent_ns = sum(sample.woke_ns, row.integer(4));
  if (const auto after = row.optional_integer(5)) sample.received_ns = sum(sample.sent_ns, *after);
  sample.server_received_ns = row.optional_integer(6).value_or(0);
  if (const auto after = row.optional_integer(7))
    sample.server_sent_ns = sum(sample.server_received_ns, *after);
  const auto skipped = row.integer(8);
  const auto fate = row.integer(9);
  sample.passed_wake_ns = row.integer(10);
  if (fate < 0 || fate > static_cast<std::int64_t>(roundtrip::Fate::lost))
    damaged(connection, fmt::format("message {} has fate {}", index, fate));
  if (skipped < 0 || skipped > std::numeric_limits<std::uint32_t>::max())
    damaged(connection, fmt::format("message {} skipped {} cycles", index, skipped));
  sample.skipped_cycles = static_cast<std::uint32_t>(skipped);
  sample.fate = static_cast<roundtrip::Fate>(fate);
  if (!can_be(sample)) damaged(connection, fmt::format("the times of message {} are impossible", index));
  return sample;
}

}  // namespace

Reader::Reader(const std::string& path) : Reader(connect(path)) {
  if (format_of(*connection_) == 0)
    throw WrongFile(fmt::format("{}: it is empty, not a results file of ontime. Choose another file.", path));
}

Reader::Reader(std::shared_ptr<Connection> connection) : connection_(std::move(connection)) {}

std::vector<Run> Reader::runs(std::optional<std::int64_t> from) const {
  std::vector<Run> runs;
  Texts text_in(*connection_);
  Ascending in_order(*connection_, "run", 1);
  // Without a beginning that is named nothing is passed over, whatever number it has.
  Statement row(*connection_,
                fmt::format("SELECT number, asked, outcome, start_ns, started_at FROM run{} ORDER BY number",
                            from ? " WHERE number >= ?" : "")
                    .c_str());
  if (from) row.bind(*from);
  while (row.next()) {
    const auto number = in_order(row.integer(0));
    auto asked = parsed(*connection_, number, text_in(row, 1));
    auto outcome = parsed(*connection_, number, text_in(row, 2));
    auto key = key_of(asked);  // not the column: format 1 has none, and this one is right
    auto start_ns = row.optional_integer(3);
    if (!can_be(start_ns.value_or(0))) start_ns.reset();
    runs.push_back(
        {number, std::move(asked), std::move(outcome), std::move(key), start_ns, utf8_of(text_in(row, 4))});
  }
  return runs;
}

std::vector<Note> Reader::notes(std::int64_t run) const {
  std::vector<Note> notes;
  const auto start = row_of(*connection_, run);
  const auto version = connection_->number("PRAGMA user_version");
  if (version == 1) return notes;
  Texts text_in(*connection_);
  Ascending in_order(*connection_, "note", 1);
  Statement row(*connection_,
                fmt::format("SELECT number, kind, text, at_ns, message, {} FROM note WHERE run = ? "
                            "ORDER BY number",
                            version < 4 ? "NULL" : "cause")
                    .c_str());
  row.bind(run);
  while (row.next()) {
    const auto number = in_order(row.integer(0));
    Note note{utf8_of(text_in(row, 1)), utf8_of(text_in(row, 2)), row.optional_integer(3), {}};
    const auto message = row.optional_integer(4);
    if (message.value_or(0) < 0 || !can_be(note.at_ns.value_or(0)))
      damaged(*connection_, fmt::format("note {} has an impossible time or message", number));
    if (message) note.message = static_cast<std::uint64_t>(*message);
    note.cause = cause_of(parsed(*connection_, run, text_in(row, 5)));
    notes.push_back(std::move(note));
  }
  return notes;
}

void Reader::each_trace(std::int64_t run, const std::function<void(const Trace&)>& use) const {
  const auto start = row_of(*connection_, run);
  if (connection_->number("PRAGMA user_version") < 3) return;
  Texts text_in(*connection_);
  Statement row(*connection_, "SELECT message, host, events FROM trace WHERE run = ? ORDER BY message, host");
  row.bind(run);
  while (row.next()) {
    const auto message = row.integer(0);
    Trace trace{utf8_of(text_in(row, 1)), {}};
    const auto events = parsed(*connection_, run, text_in(row, 2));
    try {
      trace.window = trace::window_of(events);
      trace.way = at(events, "way");
    } catch (const trace::Error& error) {
      damaged(*connection_, fmt::format("a trace of message {} has {}", message, error.what()));
    } catch (const nlohmann::json::exception&) {
      damaged(*connection_, fmt::format("a trace of message {} is invalid", message));
    }
    if (static_cast<std::int64_t>(trace.window.span.message) != message)
      damaged(*connection_, fmt::format("a trace of message {} belongs to another message", message));
    use(trace);
  }
}

std::int64_t Reader::number_of_samples(std::int64_t run) const {
  Statement row(*connection_, "SELECT count(*) FROM sample WHERE run = ?");
  row.bind(run);
  return row.next() ? row.integer(0) : 0;
}

void Reader::each_sample(std::int64_t run, std::uint64_t from,
                         const std::function<void(const roundtrip::Sample&)>& use) const {
  auto start = row_of(*connection_, run);
  // As above: without a beginning nothing is passed over.
  const auto sql = fmt::format(
      "SELECT message, intended_ns, due_after_ns, woke_after_ns, sent_after_ns, received_after_ns, "
      "server_received_ns, server_sent_after_ns, skipped_cycles, fate, {} FROM sample WHERE run = ?{} "
      "ORDER BY message",
      connection_->number("PRAGMA user_version") == 1 ? "0" : "passed_wake_ns",
      from > 0 ? " AND message >= ?" : "");
  Statement row(*connection_, sql.c_str());
  row.bind(run);
  if (from > 0) row.bind(static_cast<std::int64_t>(from));
  Ascending in_order(*connection_, "message", static_cast<std::int64_t>(from));
  if (!row.next()) return;
  const auto start_ns = start.integer(0);
  do {
    use(sample_of(row, in_order(row.integer(0)), start_ns, *connection_));
  } while (row.next());
}

// SQLite's locks in a log are bytes of the file beside it, https://sqlite.org/walformat.html; a Writer has
// the one for writing at all times.
bool is_being_written(const std::string& path) {
  constexpr off_t write_lock = 120;
  std::error_code ignored;
  const auto beside = std::filesystem::weakly_canonical(path, ignored).string() + "-shm";
  const int file = ::open(beside.c_str(), O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
  if (file < 0) return false;
  struct flock lock {};
  lock.l_type = F_RDLCK;
  lock.l_whence = SEEK_SET;
  lock.l_start = write_lock;
  lock.l_len = 1;
  const bool asked = ::fcntl(file, F_GETLK, &lock) == 0;
  ::close(file);
  return asked && lock.l_type == F_WRLCK;
}

}  // namespace ontime::record

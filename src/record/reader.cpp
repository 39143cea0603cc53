// SPDX-License-Identifier: Apache-2.0
#include <filesystem>
#include <system_error>
#include <utility>

#include <fmt/format.h>

#include "record/connection.hpp"
#include "record/format.hpp"
#include "record/record.hpp"

namespace ontime::record {
namespace {

void require_file(const std::string& path) {
  std::error_code error;
  if (std::filesystem::is_regular_file(path, error)) return;
  throw WrongFile(
      fmt::format("{}: {}. Name a results file that `ontime run` or `ontime ping --results` wrote.", path,
                  error ? error.message() : "it is not a file"));
}

// What a killed Writer committed may lie in the log beside the file. SQLite needs to lock that log while
// reading it, in a file of its own; where that cannot be made, nobody can be writing either, but the log
// cannot be read.
std::shared_ptr<Connection> connect(const std::string& path) {
  require_file(path);
  auto connection = std::make_shared<Connection>(path, SQLITE_OPEN_READONLY);
  try {
    connection->has_format();
    return connection;
  } catch (const Error&) {
    const int code = sqlite3_errcode(connection->handle()) & 0xff;
    if (code != SQLITE_CANTOPEN && code != SQLITE_READONLY) throw;
    std::error_code ignored;
    const std::string log = std::filesystem::canonical(path, ignored).string() + "-wal";
    if (std::filesystem::exists(log, ignored) && std::filesystem::file_size(log, ignored) > 0)
      throw Error(fmt::format(
          "{}: its newest samples are in {}, which cannot be read in a read-only place. Copy both "
          "to a folder that permits writing, and read them there.",
          path, log));
    return std::make_shared<Connection>(path, SQLITE_OPEN_READONLY, true);
  }
}

nlohmann::json json_of(const std::string& text, std::int64_t run, const std::string& path) {
  if (text.empty()) return nullptr;
  auto value = nlohmann::json::parse(text, nullptr, false);
  if (value.is_discarded())
    throw WrongFile(fmt::format("{}: it is damaged (run {} holds no JSON).", path, run));
  return value;
}

// In the order of the columns of `sample`, without `run`.
roundtrip::Sample sample_of(Statement& row, std::int64_t start_ns, const std::string& path) {
  roundtrip::Sample sample{};
  sample.index = static_cast<std::uint64_t>(row.integer(0));
  sample.intended_ns = sum(start_ns, row.integer(1));
  sample.due_ns = sum(sample.intended_ns, row.integer(2));
  sample.woke_ns = sum(sample.due_ns, row.integer(3));
  sample.sent_ns = sum(sample.woke_ns, row.integer(4));
  if (const auto after = row.optional_integer(5)) sample.received_ns = sum(sample.sent_ns, *after);
  sample.server_received_ns = row.optional_integer(6).value_or(0);
  if (const auto after = row.optional_integer(7))
    sample.server_sent_ns = sum(sample.server_received_ns, *after);
  sample.skipped_cycles = static_cast<std::uint32_t>(row.integer(8));
  const auto fate = row.integer(9);
  if (fate < 0 || fate > static_cast<std::int64_t>(roundtrip::Fate::lost))
    throw WrongFile(fmt::format("{}: it is damaged (message {} has fate {}).", path, sample.index, fate));
  sample.fate = static_cast<roundtrip::Fate>(fate);
  return sample;
}

}  // namespace

Reader::Reader(const std::string& path) : Reader(connect(path)) {
  if (!connection_->has_format())
    throw WrongFile(fmt::format("{}: it is empty, not a results file of ontime. Choose another file.", path));
}

Reader::Reader(std::shared_ptr<Connection> connection) : connection_(std::move(connection)) {}

std::vector<Run> Reader::runs() const {
  const auto& name = connection_->name();
  std::vector<Run> runs;
  Statement row(*connection_, "SELECT number, asked, outcome FROM run ORDER BY number");
  while (row.next()) {
    const auto number = row.integer(0);
    runs.push_back({number, json_of(row.text(1), number, name), json_of(row.text(2), number, name), {}});
  }
  return runs;
}

void Reader::each_sample(std::int64_t run, const std::function<void(const roundtrip::Sample&)>& use) const {
  Statement start(*connection_, "SELECT start_ns FROM run WHERE number = ?");
  if (!start.bind(run).next()) throw Error(fmt::format("{}: there is no run {}.", connection_->name(), run));
  Statement row(*connection_,
                "SELECT message, intended_ns, due_after_ns, woke_after_ns, sent_after_ns, received_after_ns, "
                "server_received_ns, server_sent_after_ns, skipped_cycles, fate "
                "FROM sample WHERE run = ? ORDER BY message");
  row.bind(run);
  while (row.next()) use(sample_of(row, start.integer(0), connection_->name()));
}

}  // namespace ontime::record

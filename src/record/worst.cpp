// SPDX-License-Identifier: Apache-2.0
#include "record/worst.hpp"

#include <algorithm>
#include <utility>

#include <fmt/format.h>

#include "record/record.hpp"

namespace ontime::record {
namespace {

constexpr std::uint64_t bytes_a_run = 64 << 10;

// How many times its limit it took: comparable from topic to topic.
double badness(std::optional<std::int64_t> took_ns, std::optional<std::int64_t> limit_ns) {
  return static_cast<double>(took_ns.value_or(0)) /
         static_cast<double>(std::max<std::int64_t>(limit_ns.value_or(0), 1));
}

}  // namespace

void delete_run(Connection& connection, std::int64_t run) {
  // In pieces: a statement that takes too many steps without a row counts as one that never ends.
  for (const auto& [table, key] :
       {std::pair("sample", "message"), std::pair("note", "number"), std::pair("trace", "message")}) {
    Statement some(connection, fmt::format("DELETE FROM {0} WHERE run = ?1 AND {1} IN "
                                           "(SELECT {1} FROM {0} WHERE run = ?1 LIMIT 32768)",
                                           table, key)
                                   .c_str());
    do some.bind(run).execute();
    while (sqlite3_changes(connection.handle()) > 0);
  }
  Statement(connection, "DELETE FROM run WHERE number = ?").bind(run).execute();
}

Worst::Worst(Connection& connection, std::uint64_t bytes)
    : connection_(connection),
      most_bytes_(bytes),
      most_runs_(std::max<std::uint64_t>(bytes / bytes_a_run, 1)),
      page_bytes_(connection.number("PRAGMA page_size")) {
  Statement row(connection_,
                "SELECT trace.run, trace.message, received_after_ns, "
                "CAST(json_extract(asked, '$.deadline_us') * 1000 AS INTEGER) "
                "FROM trace JOIN run ON run.number = trace.run "
                "LEFT JOIN sample ON sample.run = trace.run AND sample.message = trace.message "
                "WHERE json_extract(asked, '$.kept') = 'worst'");
  while (row.next())
    kept_.emplace(badness(row.optional_integer(2), row.optional_integer(3)), row.integer(0), row.integer(1));
  forget_old_runs({});
  while (used_bytes() > most_bytes_ && !kept_.empty()) forget_least();
  if (const auto used = used_bytes(); used > most_bytes_)
    throw Error(fmt::format(
        "{}: its data without late messages takes {:.1f} MB; at most {:.1f} MB (three quarters of the bound) "
        "are allowed. Choose another file, or a greater bound.",
        connection_.name(), static_cast<double>(used) / 1e6, static_cast<double>(most_bytes_) / 1e6));
}

bool Worst::is_too_good(std::int64_t run, std::int64_t message) {
  if (gone_ < 0 || badness_of(run, message) > gone_) return false;
  forget(run, message);
  return true;
}

bool Worst::make_room(std::int64_t run, std::int64_t message, std::uint64_t bytes) {
  const Kept one{badness_of(run, message), run, message};
  kept_.insert(one);
  while (used_bytes() + bytes > most_bytes_ && kept_.contains(one)) forget_least();
  return kept_.contains(one);
}

void Worst::forget_old_runs(const std::set<std::int64_t>& but) {
  std::vector<std::int64_t> runs;
  Statement row(connection_,
                "SELECT number FROM run WHERE json_extract(asked, '$.kept') = 'worst' ORDER BY number");
  while (row.next()) runs.push_back(row.integer(0));
  auto left = runs.size();
  for (const auto run : runs) {
    if (left <= most_runs_) return;
    if (but.contains(run)) continue;
    delete_run(connection_, run);
    std::erase_if(kept_, [&](const Kept& kept) { return std::get<1>(kept) == run; });
    --left;
  }
}

double Worst::badness_of(std::int64_t run, std::int64_t message) {
  Statement row(connection_,
                "SELECT received_after_ns, CAST(json_extract(asked, '$.deadline_us') * 1000 AS INTEGER) "
                "FROM run LEFT JOIN sample ON sample.run = number AND message = ?2 WHERE number = ?1");
  if (!row.bind(run).bind(message).next()) return 0;
  return badness(row.optional_integer(0), row.optional_integer(1));
}

// Pages that are free are used again.
std::uint64_t Worst::used_bytes() {
  const auto pages = connection_.number("PRAGMA page_count") - connection_.number("PRAGMA freelist_count");
  return static_cast<std::uint64_t>(std::max<std::int64_t>(pages, 0) * page_bytes_);
}

void Worst::forget(std::int64_t run, std::int64_t message) {
  for (const auto* sql : {"DELETE FROM trace WHERE run = ?1 AND message = ?2",
                          "DELETE FROM note WHERE run = ?1 AND message = ?2"})
    Statement(connection_, sql).bind(run).bind(message).execute();
  Statement(connection_,
            fmt::format("DELETE FROM sample WHERE run = ?1 AND message BETWEEN ?2 - {0} AND ?2 + "
                        "{0} AND NOT EXISTS (SELECT 1 FROM trace WHERE trace.run = ?1 AND "
                        "trace.message BETWEEN sample.message - {0} AND sample.message + {0})",
                        samples_around)
                .c_str())
      .bind(run)
      .bind(message)
      .execute();
}

void Worst::forget_least() {
  const auto [badness, run, message] = *kept_.begin();
  kept_.erase(kept_.begin());
  gone_ = std::max(gone_, badness);
  forget(run, message);
}

}  // namespace ontime::record

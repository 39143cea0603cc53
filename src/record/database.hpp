// SPDX-License-Identifier: Apache-2.0
// A results file that is written to. All of it may wait for the disk.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include <sys/stat.h>

#include "record/connection.hpp"
#include "record/record.hpp"
#include "record/worst.hpp"

namespace ontime::record {

// Data to add, each with its run. Kept in the pieces that arrived: no piece is empty or moved by growth.
struct Batch {
  std::map<std::int64_t, std::deque<std::vector<roundtrip::Sample>>> samples;
  std::vector<std::pair<std::int64_t, Note>> notes;
  std::vector<std::pair<std::int64_t, Trace>> traces;
  std::map<std::int64_t, std::string> outcomes;
};

// Whether the path still leads to that file, and not to a replacement.
bool is_at(const std::string& path, const struct stat& file);

class Database {
 public:
  // As of Writer. `made`: what that path led to when the file was made for it.
  Database(const std::string& path, const std::optional<struct stat>& made);
  ~Database();  // leaves one file, or none where it was made and no run is in it
  Database(const Database&) = delete;
  Database& operator=(const Database&) = delete;

  // Each is one transaction. A failed one is rolled back completely, because SQLite may have done
  // so only in part.
  std::int64_t begin_run(const std::string& asked, const std::string& key);
  void add(const Batch&);
  void forget_run(std::int64_t run);
  void end_run(std::int64_t run, const std::string& outcome);
  void keep_worst(std::uint64_t bytes);

  bool has_run(std::int64_t run);
  bool has_moved() const;  // of any thread
  const std::shared_ptr<Connection>& connection() const { return connection_; }

 private:
  void migrate(std::int64_t from);
  template <class Change>
  void commit(Change change);
  void copy_log();
  std::int64_t start_of(std::int64_t run, const roundtrip::Sample& first);
  void add(std::int64_t run, std::int64_t start_ns, const roundtrip::Sample&);
  void add(std::int64_t run, const Note&);
  void add(std::int64_t run, const Trace&);
  void set_outcome(std::int64_t run, const std::string& outcome);

  bool leave_one_file();
  void remove_unused();

  const std::string path_;
  const std::optional<struct stat> made_;
  struct stat file_ {};
  std::shared_ptr<Connection> connection_;
  std::optional<Statement> insert_;
  std::optional<Worst> worst_;  // nothing: all is kept
  std::uint64_t most_bytes_ = 0;
  bool is_worst_stale_ = false;  // a change of the file was taken back
  std::set<std::int64_t> open_runs_;
  std::map<std::int64_t, std::int64_t>
      starts_;         // run.start_ns, of those that have samples and have not ended
  int log_pages_ = 0;  // as of the last commit
  int enough_log_pages_;
};

}  // namespace ontime::record

// SPDX-License-Identifier: Apache-2.0
// Keeps a file within a bound: deletes traced messages of runs that keep only the worst, the least bad first.
// Each call is within a transaction.
#pragma once

#include <cstdint>
#include <set>
#include <tuple>

#include "record/connection.hpp"

namespace ontime::record {

void delete_run(Connection&, std::int64_t run);

class Worst {
 public:
  // Makes the file that small; throws Error if it cannot.
  Worst(Connection&, std::uint64_t bytes);

  // Whether a message at least as bad was deleted already; then deletes this one too.
  bool is_too_good(std::int64_t run, std::int64_t message);
  // Makes room for this message's trace; false: the others are worse, and this one is deleted.
  bool make_room(std::int64_t run, std::int64_t message, std::uint64_t bytes);
  // All runs except those.
  void forget_old_runs(const std::set<std::int64_t>& but);

 private:
  using Kept = std::tuple<double, std::int64_t, std::int64_t>;  // badness, run, message
  double badness_of(std::int64_t run, std::int64_t message);
  std::uint64_t used_bytes();
  void forget(std::int64_t run, std::int64_t message);
  void forget_least();

  Connection& connection_;
  const std::uint64_t most_bytes_, most_runs_;
  const std::int64_t page_bytes_;
  std::set<Kept> kept_;  // the least bad first
  double gone_ = -1;     // the badness of the worst that has gone
};

}  // namespace ontime::record

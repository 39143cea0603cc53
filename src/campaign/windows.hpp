// SPDX-License-Identifier: Apache-2.0
// For a run with `explain: on`: chooses the messages whose kernel events are kept: lost ones, late ones (by
// response time too), and the slowest of the others. The events are requested while the keepers still have
// them; the worst are kept.
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <map>
#include <set>
#include <span>
#include <string>

#include "campaign/machines.hpp"
#include "record/record.hpp"
#include "roundtrip/clocks.hpp"

namespace ontime::campaign {

// A message that is worth a look; ordered by how bad it is.
struct Chosen {
  std::int64_t badness_ns;
  std::uint64_t message;
  auto operator<=>(const Chosen&) const = default;  // NOLINT(modernize-use-nullptr): it means <=> 0
};

class Windows {
 public:
  // For the run with that number among those that are measured at the same time.
  Windows(Machines&, const Run&, std::size_t number);

  void add(std::span<const roundtrip::Sample>);
  // Requests the windows of the messages chosen since the last request, when all of that came: the keeper
  // answers in turn, and other orders must not wait for many windows. Call it in the loop, not in a handler.
  void order();
  void take(const std::string& host, trace::Window window);
  // The number of the run of a window, among those that are measured at the same time. Throws Error.
  static std::size_t number_of(const trace::Window&);
  bool all_came() const { return awaited_ == 0 && wanted_.empty(); }
  void write(record::Writer&, std::int64_t run);

 private:
  void choose(const roundtrip::Sample&);
  void forget(std::uint64_t message);

  Machines& machines_;
  const std::string component_;
  const std::chrono::nanoseconds deadline_;
  const std::uint64_t first_message_;  // the number of its first message among all runs
  roundtrip::Clocks clocks_;
  std::array<std::set<Chosen>, 3>
      chosen_;  // by fate (a late response time counts as late); the least bad first
  std::map<std::uint64_t, trace::Span> wanted_;
  std::multimap<std::uint64_t, record::Trace> traces_;
  std::size_t awaited_ = 0;
};

}  // namespace ontime::campaign

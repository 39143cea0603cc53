// SPDX-License-Identifier: Apache-2.0
// This machine's clock: what it is set by, and how far it may be off.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include <time.h>

namespace ontime::machine {

std::int64_t read_ns(clockid_t);

// CLOCK_MONOTONIC and another clock at one moment: of several readings the one that took least, so that
// being preempted is no difference.
struct Reading {
  std::int64_t monotonic_ns = 0, other_ns = 0;
};
Reading read_beside_monotonic(clockid_t other);

struct Synchronisation {
  bool synchronised = false;
  std::optional<std::int64_t> error_ns;
  std::optional<std::string> reference;  // whose time it is
};

// Of what `chronyc -c tracking` says. A clock that is its own reference is not synchronised.
std::optional<Synchronisation> parse_chrony(const std::string& text);
// Of what `pmc` says to GET CURRENT_DATA_SET and GET PARENT_DATA_SET: of a grandmaster, too, whose own time
// it is.
std::optional<Synchronisation> parse_ptp(const std::string& text);

}  // namespace ontime::machine

// SPDX-License-Identifier: Apache-2.0
// Checks whether a run's messages went over the requested link: by the kernel's counters, not by the settings
// of the middleware.
#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "record/outcome.hpp"

namespace ontime::campaign {

// A component before the run: the address that the scenario states, and all that its host has.
struct Claim {
  std::string component, ssh, stated;
  std::vector<std::string> owned;
};
// The error, for people, if a stated address is not of that component's host but of another one's: that one
// would answer. An address with a port may lead there by a router's rule, and no known host may have one.
std::optional<std::string> at_another(const std::vector<Claim>&);

// From a run's outcome (its counters, and `answered`, `link` and `shared_memory` of its hosts): the error,
// for people; nothing if the component answered all answered messages and every end's interface carried at
// least these, or no interface was requested. Other traffic on the link can hide missing messages, so shared
// memory of a middleware at both ends of one machine is an error by itself. Ontime's own traffic is left out
// where it could be counted apart (`beside_traffic`).
std::optional<std::string> went_elsewhere(const record::Outcome&, std::uint64_t payload_bytes);

// For a run with launch-time: the error, for people, if the etf at an end counted fewer frames than messages.
// A message that bypasses the etf leaves at once, without its launch time.
std::optional<std::string> went_past_etf(const record::Outcome&);

// Why went_elsewhere() verifies nothing, for people: the interface of an end (`with_traffic`: which hosts)
// had concurrent traffic of any run that could not be left out, or its counters were removed.
std::optional<std::string> unproved(const record::Outcome&, const std::set<std::string>& with_traffic);

}  // namespace ontime::campaign

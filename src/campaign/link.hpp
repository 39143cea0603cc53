// SPDX-License-Identifier: Apache-2.0
// Whether a run's messages went over the link that was asked for: by what the kernel counted there, not by
// what the middlewares were told.
#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <string>

#include <nlohmann/json.hpp>

namespace ontime::campaign {

// Of a run's outcome (its counters, and `answered`, `link` and `shared_memory` of its hosts): what is wrong,
// for people; nothing if the component answered what was answered, and every end's interface carried at least
// that, or no interface was asked for. Other traffic on the link can make up for what is missing, so where
// both ends are one machine and both have a middleware's shared memory in use, that is wrong by itself.
// Concurrent traffic that ontime itself asked for is left out, where that could be counted
// (`beside_traffic`).
std::optional<std::string> went_elsewhere(const nlohmann::json& outcome, std::uint64_t payload_bytes);

// Of a run with a launch time: whether its messages were kept for it, by what the etf counted at each end:
// what is wrong, for people. One that went past it left at once, and its launch time was nothing but a word.
std::optional<std::string> went_past_etf(const nlohmann::json& outcome);

// Why that proves nothing, for people: there was concurrent traffic, whosever, on the interface of an end
// (`with_traffic`: which of its hosts), and it could not be left out; or what counts was not there to the
// end.
std::optional<std::string> unproved(const nlohmann::json& outcome, const std::set<std::string>& with_traffic);

}  // namespace ontime::campaign

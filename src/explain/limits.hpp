// SPDX-License-Identifier: Apache-2.0
// What an account of a run cannot tell, and why: for people.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "explain/explain.hpp"

namespace ontime::explain {

using Traces = std::vector<const record::Trace*>;
using TracesByMessage = std::map<std::uint64_t, Traces>;

// By `ontime ping`: it knows only its own end.
bool is_by_hand(const record::Run&);

// `clocks_ns`: how well the clocks of two machines are known beside one another; nullopt: they are one.
std::vector<std::string> limits_of(const Account&, const record::Run&, const TracesByMessage&,
                                   bool one_machine, std::optional<std::int64_t> clocks_ns);

}  // namespace ontime::explain

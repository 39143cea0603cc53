// SPDX-License-Identifier: Apache-2.0
// What an account of a run cannot show, and why: sentences for the user.
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

// A run by `ontime ping`: it knows only its own end.
bool is_by_hand(const record::Run&);

// `clocks_ns`: the error of the offset between the two machines' clocks; nullopt: there is one machine.
std::vector<std::string> limits_of(const Account&, const record::Run&, const TracesByMessage&,
                                   bool one_machine, std::optional<std::int64_t> clocks_ns);

}  // namespace ontime::explain

// SPDX-License-Identifier: Apache-2.0
// A run by hand of which both ends are on one machine, though only ping says what it knows.
#pragma once

#include <optional>

#include "explain/way.hpp"

namespace ontime::explain {

// The server's end, by what the kernel did: the client's packets went over the loopback, and other threads
// sent packets of that size when they were answered. nullopt: it shows no such thing.
std::optional<End> end_over_loopback(const record::Reader&, const record::Run&, const End& client,
                                     std::int64_t packet_bytes);

}  // namespace ontime::explain

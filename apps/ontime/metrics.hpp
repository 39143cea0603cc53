// SPDX-License-Identifier: Apache-2.0
// What Prometheus reads over HTTP.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>

#include "command.hpp"
#include "listen/listen.hpp"
#include "watch/watch.hpp"

namespace ontime::app {

// Adds --metrics.
void add_metrics(Command&, std::string& address);
// Says where they are; without an address nullptr. Throws campaign::Error: 2 it is no address, 3 it cannot be
// had.
std::unique_ptr<watch::Metrics> metrics_at(const std::string& address);

// Of the flows, and of late messages by their cause; "not looked for" of those that were not explained.
std::string metrics_of(const listen::Findings&, const std::map<std::string, std::uint64_t>& late_by_cause);

}  // namespace ontime::app

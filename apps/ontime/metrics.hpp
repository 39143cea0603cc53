// SPDX-License-Identifier: Apache-2.0
// What Prometheus reads over HTTP.
#pragma once

#include <memory>
#include <string>

#include "command.hpp"
#include "watch/watch.hpp"

namespace ontime::app {

// Adds --metrics.
void add_metrics(Command&, std::string& address);
// Says where they are; without an address nullptr. Throws campaign::Error: 2 it is no address, 3 it cannot be
// had.
std::unique_ptr<watch::Metrics> metrics_at(const std::string& address);

}  // namespace ontime::app

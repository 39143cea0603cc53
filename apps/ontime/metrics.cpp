// SPDX-License-Identifier: Apache-2.0
#include "metrics.hpp"

#include <stdexcept>

#include <fmt/format.h>

#include "campaign/campaign.hpp"
#include "flags.hpp"
#include "terminal.hpp"

namespace ontime::app {
void add_metrics(Command& command, std::string& address) {
  command
      .add_option("--metrics", address, "offer Prometheus the same over HTTP; of a PORT alone on loopback")
      ->type_name("[ADDR:]PORT")
      ->check(given);
}

std::unique_ptr<watch::Metrics> metrics_at(const std::string& address) {
  if (address.empty()) return nullptr;
  try {
    auto metrics = std::make_unique<watch::Metrics>(address);
    print_error(fmt::format("metrics are at http://{}/metrics", metrics->address()));
    return metrics;
  } catch (const std::invalid_argument& error) {
    throw campaign::Error(2, fmt::format("--metrics: {}", error.what()));
  } catch (const std::runtime_error& error) {
    throw campaign::Error(3, fmt::format("--metrics: {}", error.what()));
  }
}

}  // namespace ontime::app

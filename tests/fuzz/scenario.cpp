// SPDX-License-Identifier: Apache-2.0
// A scenario file is read or refused in words, whatever it holds.
#include <cstdint>
#include <cstdlib>
#include <string>

#include "campaign/campaign.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string text(reinterpret_cast<const char*>(data), size);
  try {
    const auto scenario = ontime::campaign::parse_scenario("scenario", text, {});
    if (scenario.size() == 0 || scenario.runs.empty()) std::abort();
    for (const auto number : {std::size_t{0}, scenario.size() - 1})
      ontime::campaign::asked(scenario.at(number), scenario.hosts).dump();  // what is read can be recorded
  } catch (const ontime::campaign::Error& error) {
    if (error.exit != 2) std::abort();
  }
  return 0;
}

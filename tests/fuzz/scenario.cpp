// SPDX-License-Identifier: Apache-2.0
// A scenario file is read or refused in words, whatever it holds.
#include "scenario/scenario.hpp"

#include <cstdint>
#include <cstdlib>
#include <string>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string text(reinterpret_cast<const char*>(data), size);
  try {
    const auto scenario = ontime::scenario::parse_scenario("scenario", text, {});
    if (scenario.size() == 0 || scenario.runs.empty()) std::abort();
    for (const auto number : {std::size_t{0}, scenario.size() - 1})
      for (const auto& run : ontime::scenario::together(scenario.at(number), scenario.hosts))
        ontime::conditions::asked(run, scenario.hosts).dump();  // what is read can be recorded
  } catch (const ontime::scenario::Error&) {
  }
  return 0;
}

// SPDX-License-Identifier: Apache-2.0
// How often a value was seen, and what is known of those that were not kept.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

namespace ontime::foreign {

// Throws record::WrongFile: file, where in it, what is wrong.
[[noreturn]] void fail(const std::string& file, const std::string& where, const std::string& what);

struct Histogram {
  std::vector<std::pair<std::uint64_t, std::uint64_t>> values;  // ascending: value, how many, at least one
  std::uint64_t beyond = 0;                                     // values of `beyond_from` or more, not kept
  std::uint64_t beyond_from = 0;
  std::uint64_t min = 0, max = 0;  // of all
  double mean = 0;                 // of all
};

// `outcome.histogram`, in nanoseconds. Throws if what the tool says of the whole does not fit what it kept.
nlohmann::json json_of(const Histogram&, std::int64_t unit_ns, const std::string& file,
                       const std::string& where);

}  // namespace ontime::foreign

// SPDX-License-Identifier: Apache-2.0
// Pieces of text from a run's record, of which anything may be missing.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <nlohmann/json.hpp>

#include "report/report.hpp"

namespace ontime::report {

inline constexpr const char* nothing = "-";

using record::at;
std::string word(const nlohmann::json&);  // on one line; `nothing` for null
std::string word(const std::string&);     // on one line; `nothing` for an empty text
std::string word(std::optional<std::int64_t>);
std::string id_of(const record::Asked&);             // on one line, and shortened
std::string cell_of(const nlohmann::ordered_json&);  // as a spreadsheet has it

std::string microseconds(double ns);                                           // "1234", below 100 "98.7"
std::string duration(std::chrono::nanoseconds);                                // "10 ms"
std::string megabits(std::optional<double> bit_s);                             // "80", "38.2"
std::string many(std::uint64_t number, const char* one, const char* several);  // "1 run", "2 runs"
std::string size(std::uint64_t bytes);                                         // "500 B", "32 KiB"
std::string join(const std::vector<std::string>&, std::string_view separator);
std::vector<std::string> split(const std::string& text, char separator);  // at least one
std::string replace_all(std::string text, std::string_view what, std::string_view with);

}  // namespace ontime::report

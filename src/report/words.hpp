// SPDX-License-Identifier: Apache-2.0
// Pieces of text from a run's record, of which anything may be missing or of another kind than expected.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include <nlohmann/json.hpp>

#include "report/report.hpp"

namespace ontime::report {

inline constexpr const char* nothing = "-";

using record::at;
std::string word(const nlohmann::json&);             // on one line; `nothing` for null
std::string id_of(const nlohmann::json& asked);      // of a run, too, and shortened
std::string cell_of(const nlohmann::ordered_json&);  // as a spreadsheet has it
bool is_true(const nlohmann::json&);
bool is_said(const nlohmann::json&);         // a text that is not empty
std::uint64_t count(const nlohmann::json&);  // 0 for what is no count

std::string microseconds(double ns);                                           // "1234", below 100 "98.7"
std::string duration(const nlohmann::json& us);                                // "10 ms"
std::string megabits(const nlohmann::json& bit_s);                             // "80", "38.2"
std::string many(std::uint64_t number, const char* one, const char* several);  // "1 run", "2 runs"
std::string size(const nlohmann::json& bytes);                                 // "500 B", "32 KiB"
std::string join(const std::vector<std::string>&, std::string_view separator);
std::vector<std::string> split(const std::string& text, char separator);  // at least one
std::string replace_all(std::string text, std::string_view what, std::string_view with);

}  // namespace ontime::report

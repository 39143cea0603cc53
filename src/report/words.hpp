// SPDX-License-Identifier: Apache-2.0
// Pieces of text from a run's record, where any part may be missing.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <initializer_list>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "record/record.hpp"
#include "table/table.hpp"

namespace ontime::report {

inline constexpr const char* nothing = "-";
inline constexpr std::size_t most_cautions = 3;  // of the first screen
std::string more_cautions(std::size_t all);      // "… and 2 more cautions (--full)", a line; "": none

using record::at;
using namespace table;  // texts and tables have the same names here

std::string word(const nlohmann::json&);  // on one line; `nothing` for null
std::string word(const std::string&);     // on one line; `nothing` for an empty text
std::string word(std::optional<std::int64_t>);
std::string id_of(const record::Asked&);  // on one line, and shortened
const char* word_of(roundtrip::Fate);     // "on time"
// The quantity that a run measures: "Round trip", for listened messages "Age" or "Period", for an imported
// run "Wake-up latency".
const char* quantity_of(const record::Asked&);
std::string cell_of(const nlohmann::ordered_json&);  // as a spreadsheet has it
// In lines, and as ASCII: what would steer a terminal becomes an escape of JSON, and the value stays the
// same.
template <class Json>
std::string json_text(const Json& value) {
  return value.dump(2, ' ', true, Json::error_handler_t::replace) + "\n";
}
std::string cell_at(const nlohmann::ordered_json&, const std::vector<std::string>& path);  // or ""

std::string microseconds(double ns);  // "1234", below 100 "98.7"
inline std::string microseconds(std::int64_t ns) { return microseconds(static_cast<double>(ns)); }
std::string milliseconds(double ns);  // without a unit: "0.123", "4.0", "250"
inline std::string percent(double share) { return table::percent(share, 2); }
double rounded_up(double number);                   // to two digits: a bound must stay one
std::string duration(std::chrono::nanoseconds);     // "10 ms"
std::string megabits(std::optional<double> bit_s);  // "80", "38.2"
std::string size(std::uint64_t bytes);              // "500 B", "32 KiB"

// The first column holds texts, the others numbers.
std::vector<Column> columns_of(const std::string& first, std::initializer_list<const char*> others);
// Cuts the texts of a column. Of those that would be the same, what they have in common before they differ is
// cut first. A row whose first cell is empty belongs to the row above; texts of different such groups may
// become the same.
void shorten_names(std::vector<std::vector<std::string>>& rows, std::size_t column, std::size_t most);
void add_once(std::vector<std::string>& all, const std::string& text);
// The value of a key; a new key is added at the end, so keys stay in the order of first use.
template <typename Key, typename Value>
Value& entry_of(std::vector<std::pair<Key, Value>>& all, const Key& key) {
  const auto known = std::ranges::find(all, key, &std::pair<Key, Value>::first);
  return known == all.end() ? all.emplace_back(key, Value{}).second : known->second;
}

inline nlohmann::ordered_json or_null(const std::string& text) {
  return text.empty() ? nlohmann::ordered_json() : nlohmann::ordered_json(text);
}
template <typename All, typename ToJson>
nlohmann::ordered_json array_of(const All& all, ToJson to_json) {
  auto array = nlohmann::ordered_json::array();
  for (const auto& one : all) array.push_back(to_json(one));
  return array;
}
template <typename Value>
nlohmann::ordered_json or_null(const std::optional<Value>& value) {
  return value ? nlohmann::ordered_json(*value) : nlohmann::ordered_json();
}

}  // namespace ontime::report

// SPDX-License-Identifier: Apache-2.0
// The findings of a sensor as text and as JSON (docs/reference/json-listen.md). Pure.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "listen/listen.hpp"
#include "record/record.hpp"

namespace ontime::app {

// As table::labelled(), for what follows the flows.
std::string labelled(const std::string& label, const std::string& text);
std::string in_ms(std::int64_t ns);  // "0.123", "12.34", "123.4"
// Of a quantile, without digits that a Distribution does not have: "0.123", "1.23", "12.3", "123".
std::string in_rounded_ms(std::int64_t ns);
std::string clock_of(std::int64_t at_ns);  // "12:13:36.750"
std::string day_of(std::int64_t at_ns);    // "2026-07-23"
// A line to go before what is told of this time, if it is of another day than before; keeps the day in `day`,
// which is empty at first.
std::string change_of_day(std::int64_t at_ns, std::string& day);
std::string words_of(const listen::Party&, const char* unknown);  // "slam [9]"
std::string topic_of(const std::string& topic);                   // "(unknown topic)" where it has no name
std::string way_of(const listen::Flow&);                          // "/scan  lidar [7] → slam [9]  40.0 Hz"
std::string time_of_silence(std::int64_t ns);                     // "2.0 s", "40.0 ms"
std::string silence_of(const listen::Flow&);                      // "for the last 2.0 s"
bool is_age_known(const listen::Flow&);
std::string open_age_of(const listen::Flow&);  // why a limit of its age is open; "": it is not
std::string pauses_of(double listened_share, std::uint64_t pauses);
std::string unseen_of(std::uint64_t sensor_lost);  // of all topics, and what to do
std::string text_of(const listen::Flow&, const listen::Limits&);
std::string text_of(const listen::Miss&, std::size_t width);
// Why it was late, for a results file. With the date: to be read weeks later. It must have a `why`.
record::Note note_of(const listen::Miss&, std::chrono::nanoseconds limit, bool with_date,
                     std::optional<std::uint64_t> message);
nlohmann::ordered_json json_of(const listen::Party&);
nlohmann::ordered_json json_of(const listen::Distribution&);
nlohmann::ordered_json json_of(const listen::Flow&);
nlohmann::ordered_json json_of(const listen::Miss&);

// Late messages, sorted by time: only the first of each cause, so that the output stays readable, and how
// many more there are. `day`: of the last one that was told.
std::string lines_of(const std::vector<listen::Miss>&, std::size_t width, std::string& day);

}  // namespace ontime::app

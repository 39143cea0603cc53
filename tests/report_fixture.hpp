// SPDX-License-Identifier: Apache-2.0
// Runs as they are recorded, and reports as they are read.
#pragma once

#include <algorithm>
#include <cstdint>
#include <iterator>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "amend.hpp"
#include "report/report.hpp"
#include "table/table.hpp"

namespace ontime::report {

using table::width_of;

using nlohmann::json;
using statistics::Summary;

constexpr std::int64_t us = 1'000, ms = 1'000'000;  // in ns

constexpr Format all_formats[] = {Format::table,    Format::json,  Format::csv,
                                  Format::markdown, Format::latex, Format::html};

json asked(const std::string& id, const std::string& transport, int repetition = 1);
json thread(const std::string& role);
json outcome();

// `answers` round trips of 1, 2, 3 … µs.
Summary summary(const json& asked, const json& outcome, std::size_t answers = 2000);

// The first group of each match.
std::vector<std::string> found_in(const std::string& text, const std::string& expression);
// A round trip of a period of 10 ms.
inline roundtrip::Sample sample(std::uint64_t index, std::int64_t round_trip_ns,
                                roundtrip::Fate fate = roundtrip::Fate::on_time) {
  roundtrip::Sample s{};
  s.index = index;
  s.intended_ns = s.due_ns = s.woke_ns = s.sent_ns = 1'000 * ms + static_cast<std::int64_t>(index) * 10 * ms;
  s.received_ns = fate == roundtrip::Fate::lost ? 0 : s.sent_ns + round_trip_ns;
  s.fate = fate;
  return s;
}

std::vector<std::string> lines_of(const std::string& text);
// The first line that begins so, as words.
std::vector<std::string> row_of(const std::string& text, const std::string& beginning);
// RFC 4180, as it is written there.
std::vector<std::vector<std::string>> parse_csv(const std::string& text);
// Each column by its name, of a row.
std::map<std::string, std::string> row_by_name(const std::string& csv, std::size_t row);

}  // namespace ontime::report

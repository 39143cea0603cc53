// SPDX-License-Identifier: Apache-2.0
// Runs as they are recorded, and reports as they are read.
#pragma once

#include <algorithm>
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

constexpr Format all_formats[] = {Format::table,    Format::json,  Format::csv,
                                  Format::markdown, Format::latex, Format::html};

inline json asked(const std::string& id, const std::string& transport, int repetition = 1) {
  return {
      {"id", id},
      {"title", "System under load"},
      {"repetition", repetition},
      {"transport", transport},
      {"payload_bytes", 500},
      {"period_us", 10000},
      {"deadline_us", 10000},
      {"timeout_us", 500000},
      {"duration_s", 20},
      {"schedule", "next-free"},
      {"receive", "listener"},
      {"warm_up", 10},
      {"realtime", false},
      {"realtime_settings", {{"on", false}}},
      {"qos",
       {{"reliability", "best-effort"}, {"history", "keep-last"}, {"depth", 1}, {"durability", "volatile"}}},
      {"load",
       {{"controller", {{"cpu", 8}, {"vm", 8}, {"io", 8}, {"hdd", 8}}},
        {"component", {{"cpu", 2}, {"vm", 2}, {"io", 2}, {"hdd", 2}}}}},
      {"command_line", {"ontime", "run", "scenarios/demo.yaml"}},
      {"ontime", "0.2.0"},
      {"scenario", "runs:\n- id: x\n"}};
}

inline json thread(const std::string& role) {
  return {{"role", role},
          {"name", "ontime-" + role},
          {"tid", 12},
          {"policy", "fifo"},
          {"priority", 80},
          {"cpus", "0-1"},
          {"minor_faults", 0},
          {"major_faults", 1},
          {"voluntary_switches", 2000},
          {"involuntary_switches", 3},
          {"cpu_time_us", 1234}};
}

inline json outcome() {
  const json host = {
      {"machine", {{"kernel", "6.1"}}},
      {"transport", {{"name", "udp"}, {"version", "0.1.0"}, {"facts", {{"interface", "link0"}}}}},
      {"threads", {thread("send"), thread("receive")}},
      {"refusals", json::array()},
      {"load_running", true}};
  return {{"sent", 2000},
          {"duplicates", 0},
          {"strays", 0},
          {"reordered", 0},
          {"dropped_records", 0},
          {"refused_sends", 0},
          {"interrupted", false},
          {"conditions", {{"controller", {{"cpu_busy", 0.99}}}, {"component", {{"cpu_busy", 0.5}}}}},
          {"hosts", {{"controller", host}, {"component", host}}}};
}

// `answers` round trips of 1, 2, 3 … µs.
inline Summary summary(const json& asked, const json& outcome, std::size_t answers = 2000) {
  Summary summary{};
  summary.run = {1, asked, outcome, "the-key"};
  summary.sent = answers;
  summary.on_time = answers;
  std::vector<std::int64_t> values(answers);
  for (std::size_t i = 0; i < answers; ++i) values[i] = static_cast<std::int64_t>(i + 1) * 1000;
  summary.round_trip = summary.response = summary.wake_up = statistics::distribution(values);
  return summary;
}

inline std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);) lines.push_back(line);
  return lines;
}

// The first line that begins so, as words.
inline std::vector<std::string> row_of(const std::string& text, const std::string& beginning) {
  for (const auto& line : lines_of(text)) {
    if (!line.starts_with(beginning)) continue;
    std::istringstream stream(line);
    return {std::istream_iterator<std::string>(stream), {}};
  }
  return {};
}

// RFC 4180, as it is written there.
inline std::vector<std::vector<std::string>> parse_csv(const std::string& text) {
  std::vector<std::vector<std::string>> records(1, {""});
  bool quoted = false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    auto& field = records.back().back();
    if (text[i] == '"' && quoted && i + 1 < text.size() && text[i + 1] == '"')
      field += text[++i];
    else if (text[i] == '"')
      quoted = !quoted;
    else if (text[i] == ',' && !quoted)
      records.back().emplace_back();
    else if (text[i] == '\n' && !quoted)
      records.push_back({""});
    else
      field += text[i];
  }
  records.pop_back();  // what follows the last line's end
  return records;
}

// Each column by its name, of a row.
inline std::map<std::string, std::string> row_by_name(const std::string& csv, std::size_t row) {
  const auto records = parse_csv(csv);
  std::map<std::string, std::string> named;
  for (std::size_t i = 0; i < records.at(0).size(); ++i) named[records[0][i]] = records.at(row + 1).at(i);
  return named;
}

}  // namespace ontime::report

// SPDX-License-Identifier: Apache-2.0
#include "report_fixture.hpp"

#include <iterator>
#include <regex>
#include <sstream>

namespace ontime::report {

json asked(const std::string& id, const std::string& transport, int repetition) {
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

json thread(const std::string& role) {
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

json outcome() {
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
          {"conditions", {{"controller", {{"cpu_busy", 0.85}}}, {"component", {{"cpu_busy", 0.5}}}}},
          {"hosts", {{"controller", host}, {"component", host}}}};
}

Summary summary(const json& asked, const json& outcome, std::size_t answers) {
  Summary summary{};
  summary.run = {1, asked, outcome, "the-key"};
  summary.sent = answers;
  summary.on_time = answers;
  std::vector<std::int64_t> values(answers);
  for (std::size_t i = 0; i < answers; ++i) values[i] = static_cast<std::int64_t>(i + 1) * 1000;
  summary.round_trip = summary.response = summary.wake_up = statistics::distribution(values);
  return summary;
}

std::vector<std::string> found_in(const std::string& text, const std::string& expression) {
  const std::regex regex(expression);
  std::vector<std::string> found;
  for (auto it = std::sregex_iterator(text.begin(), text.end(), regex); it != std::sregex_iterator(); ++it)
    found.push_back(it->str(1));
  return found;
}
std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);) lines.push_back(line);
  return lines;
}

std::vector<std::string> row_of(const std::string& text, const std::string& beginning) {
  for (const auto& line : lines_of(text)) {
    if (!line.starts_with(beginning)) continue;
    std::istringstream stream(line);
    return {std::istream_iterator<std::string>(stream), {}};
  }
  return {};
}

std::vector<std::vector<std::string>> parse_csv(const std::string& text) {
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

std::map<std::string, std::string> row_by_name(const std::string& csv, std::size_t row) {
  const auto records = parse_csv(csv);
  std::map<std::string, std::string> named;
  for (std::size_t i = 0; i < records.at(0).size(); ++i) named[records[0][i]] = records.at(row + 1).at(i);
  return named;
}

}  // namespace ontime::report

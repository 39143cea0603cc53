// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include <fmt/format.h>

#include "report/runs.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

using nlohmann::ordered_json;

double in_us(double ns) { return std::round(ns) / 1e3; }
double in_us(std::int64_t ns) { return static_cast<double>(ns) / 1e3; }

ordered_json json_of(const statistics::Distribution& of) {
  if (of.count == 0) return nullptr;
  return {{"min", in_us(of.min)},       {"mean", in_us(of.mean)}, {"p50", in_us(of.p50)},
          {"p90", in_us(of.p90)},       {"p99", in_us(of.p99)},   {"p99.9", in_us(of.p99_9)},
          {"p99.99", in_us(of.p99_99)}, {"max", in_us(of.max)}};
}

ordered_json some_of(const nlohmann::json& from, std::initializer_list<const char*> keys) {
  auto result = ordered_json::object();
  for (const auto* key : keys) result[key] = at(from, key);
  return result;
}

// Of a key of the run, or of one within: "round_trip_us/p50". Empty for null.
std::string field_of(const ordered_json& run, const std::string& key) {
  const ordered_json::json_pointer pointer("/" + key);
  if (!run.contains(pointer) || run.at(pointer).is_null()) return "";
  const auto& value = run.at(pointer);
  return value.is_string() ? value.get<std::string>()
                           : value.dump(-1, ' ', false, ordered_json::error_handler_t::replace);
}

// Measured to the end that was asked for.
bool is_complete(const statistics::Summary& summary) {
  const auto& outcome = summary.run.outcome;
  return !outcome.is_null() && at(outcome, "error").is_null() && !is_true(at(outcome, "interrupted"));
}

}  // namespace

ordered_json json_of(const statistics::Summary& summary) {
  const auto& asked = summary.run.asked;
  const auto& outcome = summary.run.outcome;
  ordered_json run = {{"run", summary.run.number}};
  run.update(some_of(asked, {"id", "title", "variant", "repetition", "transport", "payload_bytes",
                             "period_us", "deadline_us", "timeout_us", "schedule", "realtime"}));
  run["complete"] = is_complete(summary);
  run.update(some_of(outcome, {"interrupted", "error"}));
  run["sent"] = summary.sent;
  run["on_time"] = summary.on_time;
  run["late"] = summary.late;
  run["lost"] = summary.lost;
  run["skipped_cycles"] = summary.skipped_cycles;
  run.update(some_of(outcome, {"duplicates", "strays", "reordered", "refused_sends", "dropped_records"}));
  run["round_trip_us"] = json_of(summary.round_trip);
  run["response_us"] = json_of(summary.response);
  run["wake_up_us"] = json_of(summary.wake_up);
  run["server_us"] = json_of(summary.server);
  run["conditions"] =
      some_of(asked, {"duration_s", "warm_up", "receive", "qos", "options", "domain", "realtime_settings"});
  run["conditions"]["load"] = {{"asked", at(asked, "load")}, {"achieved", at(outcome, "conditions")}};
  run["hosts"] = at(outcome, "hosts");
  run["provenance"] = some_of(asked, {"ontime", "command_line", "hosts", "scenario_file", "scenario"});
  return run;
}

std::string csv_of(const Summaries& summaries) {
  std::vector<std::string> keys = {"run",         "id",          "title",          "variant",
                                   "repetition",  "transport",   "payload_bytes",  "period_us",
                                   "deadline_us", "timeout_us",  "schedule",       "realtime",
                                   "complete",    "interrupted", "sent",           "on_time",
                                   "late",        "lost",        "skipped_cycles", "duplicates",
                                   "strays",      "reordered",   "refused_sends",  "dropped_records"};
  for (const auto* distribution : {"round_trip_us", "response_us", "wake_up_us", "server_us"})
    for (const auto* value : {"min", "mean", "p50", "p90", "p99", "p99.9", "p99.99", "max"})
      keys.push_back(fmt::format("{}/{}", distribution, value));

  std::vector<std::vector<std::string>> rows;
  for (const auto& summary : summaries) {
    const auto run = json_of(summary);
    rows.emplace_back();
    for (const auto& key : keys) rows.back().push_back(field_of(run, key));
  }
  for (auto& key : keys) key = replace_all(key, "/", "_");
  return as_csv(keys, rows);
}

}  // namespace ontime::report

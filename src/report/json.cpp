// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <cmath>

#include <fmt/format.h>

#include "report/answer.hpp"
#include "report/conditions.hpp"
#include "report/paper.hpp"
#include "report/runs.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

double in_us(double ns) { return std::round(ns) / 1e3; }
double in_us(std::int64_t ns) { return static_cast<double>(ns) / 1e3; }

ordered_json object_of(const statistics::Distribution& of) {
  if (of.count == 0) return nullptr;
  ordered_json json{{"min", in_us(of.min)}, {"mean", in_us(of.mean)}};
  for (const auto& row : statistics::percentiles) json[row.name] = in_us(of[row.figure]);
  json["max"] = in_us(of.max);
  return json;
}

ordered_json wake_up_of(const statistics::Summary& summary) {
  auto wake_up = object_of(summary.wake_up);
  for (const auto& row : statistics::percentiles)
    if (statistics::is_lower_bound(summary, row.figure)) wake_up[row.name] = nullptr;
  return wake_up;
}

ordered_json some_of(const nlohmann::json& from, std::initializer_list<const char*> keys) {
  auto result = ordered_json::object();
  for (const auto* key : keys) result[key] = at(from, key);
  return result;
}

ordered_json parts_of(const statistics::Summary& summary) {
  if (summary.parts)
    return {{"clocks", summary.parts->one_clock ? "one" : "synchronised"},
            {"error_us", in_us(summary.parts->error_ns)},
            {"left_out", nullptr}};
  if (summary.no_parts.empty()) return nullptr;
  return {{"clocks", nullptr}, {"error_us", nullptr}, {"left_out", summary.no_parts}};
}

ordered_json notes_of(const statistics::Summary& summary) {
  return array_of(summary.notes, [&](const record::Note& note) -> ordered_json {
    const bool timed = note.at_ns && summary.start_ns != 0;
    return {{"kind", note.kind},
            {"text", report::text_of(note)},
            {"at_s", timed ? ordered_json(seconds_into(summary, *note.at_ns)) : ordered_json()},
            {"message", or_null(note.message)}};
  });
}

// The paper's values for this test; null if it has none.
ordered_json paper_of(const record::Asked& asked) {
  const auto rows = array_of(paper_rows(asked), [](const PaperRow& row) -> ordered_json {
    return {{"dds", row.dds},
            {"min_us", row.min_us},
            {"avg_us", row.avg_us},
            {"max_us", row.max_us},
            {"missed_deadlines", row.missed_deadlines},
            {"lost", row.lost},
            {"messages", row.messages}};
  });
  return rows.empty() ? ordered_json() : rows;
}

// A column of CSV, and where in the JSON of a run it is found.
struct Field {
  std::string name;
  std::vector<std::string> path;
};

// The columns that each file has; new ones come last.
std::vector<Field> fields() {
  std::vector<Field> fields;
  for (const auto* key : {"run",         "id",          "title",          "variant",
                          "repetition",  "transport",   "payload_bytes",  "period_us",
                          "deadline_us", "timeout_us",  "schedule",       "realtime",
                          "complete",    "interrupted", "sent",           "on_time",
                          "late",        "lost",        "skipped_cycles", "duplicates",
                          "strays",      "reordered",   "refused_sends",  "dropped_records"})
    fields.push_back({key, {key}});
  const auto add_distribution = [&](const std::string& name) {
    std::vector<std::string> values{"min", "mean"};
    for (const auto& row : statistics::percentiles) values.emplace_back(row.name);
    values.emplace_back("max");
    for (const auto& value : values) fields.push_back({fmt::format("{}_{}", name, value), {name, value}});
  };
  for (const auto* name : {"round_trip_us", "response_us", "wake_up_us", "server_us"}) add_distribution(name);
  for (const auto* key : {"key", "late_by_response", "trailing_cycles"}) fields.push_back({key, {key}});
  for (const auto* name : {"there_us", "back_us"}) add_distribution(name);
  fields.push_back({"parts_error_us", {"parts", "error_us"}});
  for (const auto* host : {"controller", "component"})
    for (const auto* kind : {"on_the_way", "overwritten"})
      fields.push_back({fmt::format("{}_lost_{}", host, kind), {"hosts", host, "losses", kind}});
  for (const auto* key : {"component_transport", "receive", "domain", "ping_topic", "pong_topic"})
    fields.push_back({key, {"conditions", key}});
  for (const auto* key : {"reliability", "history", "depth", "durability"})
    fields.push_back({fmt::format("qos_{}", key), {"conditions", "qos", key}});
  for (const auto* key : {"interface", "component_interface"}) fields.push_back({key, {"conditions", key}});
  for (const auto* name : {"round_trip_95_us", "response_95_us"})
    for (const auto& row : statistics::metrics)
      if (row.figure == statistics::Figure::mean || row.one_in > 0)
        for (const auto* end : {"low", "high"})
          fields.push_back({fmt::format("{}_{}_{}", name, row.name, end), {name, row.name, end}});
  for (const auto* what : {"late", "lost", "missed"})
    for (const auto* value : {"value", "low", "high", "bound"})
      fields.push_back({fmt::format("probability_{}_{}", what, value), {"probability", what, value}});
  for (const auto* key : {"count", "longest", "longest_ms"})
    fields.push_back({fmt::format("bursts_{}", key), {"bursts", key}});
  for (const auto* method : {"block_maxima", "peaks_over_threshold"})
    for (const auto* key : {"allowed", "level_us", "level_low_us", "level_high_us", "fit_p"})
      fields.push_back({fmt::format("{}_{}", method, key), {"extremes", method, key}});
  for (const auto* key : {"wrong_size", "wrong_server_times"}) fields.push_back({key, {key}});
  for (const auto* name : {"request_leg_us", "reply_leg_us"}) add_distribution(name);
  fields.push_back({"extremes_exceedance", {"extremes", "exceedance"}});
  for (const auto* key : {"state", "started_at", "measures", "conditions_text"})
    fields.push_back({key, {key}});
  for (const auto* key : {"component", "duration_s"}) fields.push_back({key, {"conditions", key}});
  for (const auto* host : {"controller", "component"}) {
    for (const auto* fact : {"hostname", "kernel_release"})
      fields.push_back({fmt::format("{}_{}", host, fact), {"hosts", host, "machine", fact}});
    fields.push_back({fmt::format("{}_transport_version", host), {"hosts", host, "transport", "version"}});
  }
  fields.push_back({"ontime", {"provenance", "ontime"}});
  for (const auto* value : {"value", "low", "high", "bound"})
    fields.push_back(
        {fmt::format("probability_late_by_response_{}", value), {"probability", "late_by_response", value}});
  return fields;
}

}  // namespace

ordered_json json_of(const statistics::Summary& summary, std::optional<std::int64_t> running_from) {
  const auto& asked = summary.run.asked.document;
  const auto& outcome = summary.run.outcome.document;
  ordered_json run = {{"run", summary.run.number}};
  run["key"] = or_null(summary.run.key);
  run.update(some_of(asked, {"id", "title", "variant", "measures", "repetition", "transport", "payload_bytes",
                             "period_us", "deadline_us", "timeout_us", "schedule", "realtime"}));
  run["started_at"] = or_null(summary.run.started_at);
  run["state"] = word_of(state_of(summary, running_from));
  run["complete"] = statistics::is_complete(summary.run);
  run.update(some_of(outcome, {"interrupted", "error"}));
  run["sent"] = summary.sent;
  const bool late = statistics::knows_late(summary.run), lost = statistics::knows_loss(summary.run);
  const auto known = [](bool is_known, std::uint64_t count) {
    return is_known ? ordered_json(count) : ordered_json();
  };
  run["on_time"] = known(late && lost, summary.on_time);
  run["late"] = known(late, summary.late);
  run["lost"] = known(lost, summary.lost);
  run["late_by_response"] = or_null(summary.late_by_response);
  run["skipped_cycles"] = summary.skipped_cycles;
  run.update(some_of(outcome, {"trailing_cycles", "duplicates", "strays", "reordered", "wrong_size",
                               "wrong_server_times", "refused_sends", "dropped_records"}));
  // Samples that the file lost later are missing, too.
  if (const auto missing = statistics::unrecorded(summary.run); missing > 0 && !summary.has_worst_only)
    run["dropped_records"] = missing;
  run["round_trip_us"] = object_of(summary.round_trip);
  run["response_us"] = object_of(summary.response);
  run["wake_up_us"] = wake_up_of(summary);
  run["server_us"] = object_of(summary.server);
  const auto parts = summary.parts.value_or(statistics::Parts{});
  run["request_leg_us"] = object_of(parts.there);
  run["reply_leg_us"] = object_of(parts.back);
  // Earlier names, kept for one version; so is `background` below.
  run["there_us"] = run["request_leg_us"];
  run["back_us"] = run["reply_leg_us"];
  run["parts"] = parts_of(summary);
  add_certainty(run, summary);
  run["notes"] = notes_of(summary);
  run["remarks"] = or_null(remarks(summary));
  run["imported"] = imported_json_of(summary);
  run.update(some_of(asked, {"require"}));
  run["conditions_text"] = join(shared_conditions({&summary}), ", ");
  run["conditions"] =
      some_of(asked, {"duration_s", "warm_up", "receive", "qos", "options", "security", "domain",
                      "ping_topic", "pong_topic", "interface", "launch_us", "realtime_settings",
                      "count_instructions", "kernel", "isolation", "listen"});
  run["conditions"].update(some_of(asked, {"component", "component_transport", "component_options",
                                           "component_interface", "component_restart", "beside", "others"}));
  for (const auto& [name, of_asked, of_outcome] : {std::array{"load", "load", "conditions"},
                                                   {"traffic", "traffic", "traffic"},
                                                   {"background", "neighbours", "neighbours"}})
    run["conditions"][name] = {{"asked", at(asked, of_asked)}, {"achieved", at(outcome, of_outcome)}};
  run["conditions"]["neighbours"] = run["conditions"]["background"];
  run["conditions"].update(some_of(asked, {"link", "wire"}));
  run.update(some_of(outcome, {"link_unproved"}));
  run["paper"] = paper_of(summary.run.asked);
  run.update(some_of(outcome, {"hosts"}));
  run["provenance"] = some_of(asked, {"ontime", "command_line", "hosts", "scenario_file", "scenario"});
  return run;
}

std::string csv_of(const Summaries& summaries, std::optional<std::int64_t> running_from) {
  const auto columns = fields();
  const auto options = OptionColumns(summaries);
  auto header = texts_of(columns, &Field::name);
  options.add_names(header);

  std::vector<std::vector<std::string>> rows;
  for (const auto& summary : summaries) {
    const auto run = json_of(summary, running_from);
    rows.emplace_back();
    for (const auto& column : columns) rows.back().push_back(cell_at(run, column.path));
    options.add_values(rows.back(), summary);
  }
  return as_csv(header, rows);
}

}  // namespace ontime::report

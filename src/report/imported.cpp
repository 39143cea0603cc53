// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include "report/runs.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

std::string label_of(const Summary& summary) {
  const auto variant = word(summary.run.asked.variant);
  return fmt::format("{} ({})", variant, shortened(word(summary.imported->file), 40));
}

std::string source_of(const Summary& summary) {
  const auto& imported = *summary.imported;
  auto text = fmt::format("{}: imported from {} ({})", label_of(summary), imported.file, imported.from);
  const auto& source = *summary.run.asked.imported;
  if (source.start_time) text += ", of " + word(*source.start_time);
  if (source.cmdline) text += fmt::format(", `{}`", word(*source.cmdline));
  if (imported.beyond > 0)
    text += fmt::format("; {} values are only known to be {} µs or more", imported.beyond,
                        microseconds(imported.beyond_from_ns));
  return text;
}

// "≥3.0" if the percentile is beyond the histogram; else as percentile().
std::string imported_percentile(const Summary& summary, statistics::Figure figure) {
  const auto text = percentile(summary.wake_up, figure);
  return text != nothing && statistics::is_lower_bound(summary, figure)
             ? "≥" + microseconds(summary.wake_up[figure])
             : text;
}

}  // namespace

Table imported_table_of(const Group& group) {
  Table table{
      id_of(group.front()->run.asked),
      "imported wake-up latencies, not round trips; a histogram without times: no bursts, no confidence "
      "intervals",
      columns_of("Wake-up (µs)", {"Min", "Avg"})};
  for (const auto& percentile : statistics::percentiles) table.columns.push_back({percentile.name});
  for (const auto* name : {"Max", "Values"}) table.columns.push_back({name});
  for (const auto* summary : group) {
    const auto& of = summary->wake_up;
    auto& row = table.rows.emplace_back(
        std::vector<std::string>{label_of(*summary), microseconds(of.min), microseconds(of.mean)});
    for (const auto& percentile : statistics::percentiles)
      row.push_back(imported_percentile(*summary, percentile.figure));
    row.push_back(microseconds(of.max));
    row.push_back(std::to_string(of.count));
    table.notes.push_back(source_of(*summary));
  }
  return table;
}

nlohmann::ordered_json imported_json_of(const Summary& summary) {
  if (!summary.imported) return nullptr;
  const auto& imported = *summary.imported;
  nlohmann::ordered_json result = {{"from", imported.from}, {"file", imported.file}};
  for (const auto* key : {"cmdline", "start_time"})
    result[key] = summary.run.asked.stated(fmt::format("imported.{}", key));
  result["values"] = summary.wake_up.count;
  result["beyond"] = imported.beyond;
  result["beyond_from_us"] = nullptr;
  if (imported.beyond > 0) result["beyond_from_us"] = static_cast<double>(imported.beyond_from_ns) / 1e3;
  result["resolution_us"] = static_cast<double>(imported.resolution_ns) / 1e3;
  return result;
}

}  // namespace ontime::report

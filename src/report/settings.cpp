// SPDX-License-Identifier: Apache-2.0
// What was requested and what was found: differences between runs, and once what all runs share.
#include <map>
#include <string_view>

#include <fmt/format.h>

#include "gate/gate.hpp"
#include "report/conditions.hpp"
#include "report/report.hpp"
#include "report/runs.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

using nlohmann::json;
using enum Column::Align;

// Belongs to a run, not to its machine.
constexpr std::string_view changing = "realtime_offset_ns";

std::string percent_of(std::optional<double> share) {
  return share ? fmt::format("{:.0f} %", *share * 100) : nothing;
}

std::string megabytes(const record::Link& link) {
  if (!link.sent_bytes && !link.received_bytes) return nothing;
  return fmt::format("{:.1f}", static_cast<double>(link.bytes()) / 1e6);
}

// "limits.rtprio" and what it is, for everything within.
void flatten(const json& value, const std::string& name, std::map<std::string, std::string>& into) {
  if (value.is_object()) {
    for (const auto& [key, within] : value.items())
      if (key != changing) flatten(within, name.empty() ? key : fmt::format("{}.{}", name, key), into);
  } else if (!value.is_null() && !name.empty()) {
    into[name] = word(value);
  }
}

// A host's value if it is the same in all runs, else each value with its runs.
std::string values_of(const std::vector<std::pair<std::string, std::string>>& of_runs) {
  std::vector<std::pair<std::string, std::vector<std::string>>> all;
  for (const auto& [run, value] : of_runs) entry_of(all, value).push_back(run);
  if (all.size() == 1) return all.front().first;
  const auto text = [](const auto& one) {
    const auto& [value, runs] = one;
    return fmt::format("{} ({} {})", value, runs.size() == 1 ? "run" : "runs", join(runs, ", "));
  };
  return join(texts_of(all, text), "; ");
}

// Settings that were denied: those with one remedy together.
std::vector<std::string> refusals_at(const std::vector<const record::Host*>& ends) {
  struct Refused {
    std::vector<std::string> found, asked;
  };
  std::vector<std::pair<std::string, Refused>> all;  // by remedy
  for (const auto* end : ends)
    for (const auto& refusal : end->refusals) {
      auto remedy = printable_lines(refusal.remedy);  // which are to be copied
      if (remedy.ends_with('\n')) remedy.pop_back();
      auto& [found, asked] = entry_of(all, remedy);
      add_once(found, word(refusal.found));
      add_once(asked, word(refusal.asked));
    }
  return texts_of(all, [](const auto& one) {
    return fmt::format("Requested, denied: {};\nfound: {};\nfix: {}", join(one.second.asked, ", "),
                       join(one.second.found, "; "), one.first);
  });
}

}  // namespace

std::vector<std::string> refusals(const Summaries& summaries) {
  std::vector<const record::Host*> ends;
  for (const auto& summary : summaries)
    for (const auto& [host, end] : summary.run.outcome.hosts) ends.push_back(&end);
  return refusals_at(ends);
}

std::vector<std::string> refusals_of(const record::Host& end) { return refusals_at({&end}); }

Table differences_of(const Summaries& summaries) {
  const auto all = all_of(summaries);
  const auto differences = differences_between(all);
  Table table{"Where the runs differ",
              "Same in all runs: " + join(shared_conditions(all), ", ") + ".",
              {{"Run", left}}};
  for (const auto& key : differences.keys) table.columns.push_back({key, left});
  // Runs of one id that were alike in all this are one row: their transports, and how many runs each has.
  using Row = std::pair<std::string, std::vector<std::string>>;
  std::vector<std::pair<Row, std::vector<std::pair<std::string, std::size_t>>>> rows;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const auto& asked = all[i]->run.asked;
    ++entry_of(entry_of(rows, Row{word(asked.id), differences.values[i]}), word(asked.task.transport));
  }
  for (const auto& [row, runs] : rows) {
    std::vector<std::string> transports;
    for (const auto& [transport, times] : runs)
      transports.push_back(times > 1 ? fmt::format("{} ×{}", transport, times) : transport);
    auto& cells = table.rows.emplace_back(
        std::vector<std::string>{shortened(row.first, gate::longest_id) + ": " + join(transports, ", ")});
    for (const auto& value : row.second) cells.push_back(value.empty() ? nothing : value);
  }
  return table;
}

Table loads_of(const Summaries& summaries) {
  Table table{.title = "Load: requested and achieved",
              .columns = {{"Run", left},
                          {"Host", left},
                          {"Workers requested", left},
                          {"CPU busy"},
                          {"CPU pressure"},
                          {"memory pressure"},
                          {"I/O pressure"},
                          {"MB on the link"}}};
  for (const auto& summary : summaries) {
    const auto& asked = summary.run.asked;
    const auto& outcome = summary.run.outcome;
    for (const auto& [host, load] :
         {std::pair("controller", asked.controller_load), {"component", asked.component_load}}) {
      if (!outcome.conditions.contains(host) && !outcome.hosts.contains(host)) continue;
      const auto& seen = record::find(outcome.conditions, host);
      table.rows.push_back(
          {fmt::format("{}: {} {}", summary.run.number, id_of(asked), word(asked.task.transport)), host,
           load.any() ? workers(load) : "none", percent_of(seen.cpu_busy), percent_of(seen.cpu_pressure),
           percent_of(seen.memory_pressure), percent_of(seen.io_pressure),
           megabytes(record::find(outcome.hosts, host).link)});
    }
  }
  return table;
}

Table machines_of(const Summaries& summaries) {
  Table table{.title = "Machines",
              .columns = {{"Property", left}, {"Controller", left}, {"Component", left}}};
  std::map<std::string, std::map<std::string, std::vector<std::pair<std::string, std::string>>>> all;
  for (const auto& summary : summaries) {
    for (const auto* host : record::both_hosts) {
      std::map<std::string, std::string> facts;
      flatten(record::find(summary.run.outcome.hosts, host).machine.document, "", facts);
      for (const auto& [name, value] : facts)
        all[name][host].emplace_back(fmt::format("{}", summary.run.number), value);
    }
  }
  for (auto& [name, of] : all) {
    std::vector<std::string> row = {word(name)};
    for (const auto* host : record::both_hosts)
      row.push_back(of.contains(host) ? values_of(of[host]) : nothing);
    table.rows.push_back(row);
  }
  return table;
}

}  // namespace ontime::report

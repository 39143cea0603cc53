// SPDX-License-Identifier: Apache-2.0
#include <map>

#include <fmt/format.h>

#include "report/conditions.hpp"
#include "report/runs.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

using nlohmann::json;

constexpr std::initializer_list<const char*> run_keys = {"id", "transport", "repetition"};
constexpr std::initializer_list<const char*> further_run_keys = {"component_transport", "receive"};

// Calls use(summary, the host's name, its threads) for each host whose threads were recorded.
template <class Use>
void each_host(const Summaries& summaries, Use use) {
  for (const auto& summary : summaries)
    for (const auto& [name, host] : summary.run.outcome.hosts)
      if (!host.threads.empty()) use(summary, name, host.threads);
}

// A host's threads as they were recorded.
const json& recorded(const statistics::Summary& summary, const std::string& host) {
  return conditions::member_of(summary.run.outcome.document, "hosts." + host + ".threads");
}

std::vector<std::string> row(const record::Thread& thread) {
  const auto priority = thread.priority.value_or(0);
  return {word(thread.role),
          word(thread.name),
          word(thread.tid),
          priority > 0 ? fmt::format("{} {}", word(thread.policy), priority) : word(thread.policy),
          word(thread.cpus),
          word(thread.minor_faults) + "/" + word(thread.major_faults),
          word(thread.voluntary_switches) + "/" + word(thread.involuntary_switches),
          thread.cpu_time_us ? fmt::format("{:.1f}", *thread.cpu_time_us / 1e3) : nothing};
}

// What each run is called, in the order of the summaries.
std::map<const statistics::Summary*, std::string> names_of(const Summaries& summaries) {
  std::map<const statistics::Summary*, std::string> names;
  for (const auto& group : by_id(summaries)) {
    const auto labels = labels_of(group);
    for (std::size_t i = 0; i < group.size(); ++i)
      names[group[i]] =
          fmt::format("Run {}: {}  {}", group[i]->run.number, id_of(group[i]->run.asked), labels[i]);
  }
  return names;
}

}  // namespace

ordered_json threads_json_of(const Summaries& summaries) {
  auto result = ordered_json::array();
  each_host(summaries, [&](const auto& summary, const auto& host, const auto&) {
    ordered_json entry = {{"run", summary.run.number}};
    for (const auto* key : run_keys) entry[key] = summary.run.asked.stated(key);
    for (const auto* key : further_run_keys) entry[key] = summary.run.asked.stated(key);
    for (const auto* key : {"options", "component_options"}) entry[key] = summary.run.asked.stated(key);
    entry["host"] = host;
    entry["threads"] = recorded(summary, host);
    result.push_back(entry);
  });
  return result;
}

std::string threads_csv_of(const Summaries& summaries) {
  const auto thread_keys = split(
      "role,name,tid,policy,priority,cpus,minor_faults,major_faults,voluntary_switches,involuntary_switches,"
      "cpu_time_us",
      ',');
  std::vector<std::string> header = {"run"};
  header.insert(header.end(), run_keys.begin(), run_keys.end());
  header.emplace_back("host");
  header.insert(header.end(), thread_keys.begin(), thread_keys.end());
  header.insert(header.end(), further_run_keys.begin(), further_run_keys.end());
  const OptionColumns options(summaries);
  options.add_names(header);
  std::vector<std::vector<std::string>> rows;
  each_host(summaries, [&](const auto& summary, const auto& host, const auto&) {
    for (const auto& thread : recorded(summary, host)) {
      rows.push_back({std::to_string(summary.run.number)});
      for (const auto* key : run_keys) rows.back().push_back(cell_of(summary.run.asked.stated(key)));
      rows.back().push_back(word(host));
      for (const auto& key : thread_keys) rows.back().push_back(cell_of(at(thread, key)));
      for (const auto* key : further_run_keys) rows.back().push_back(cell_of(summary.run.asked.stated(key)));
      options.add_values(rows.back(), summary);
    }
  });
  return as_csv(header, rows);
}

Page threads_page_of(const Summaries& summaries) {
  using enum Column::Align;
  Page page;
  const auto names = names_of(summaries);
  each_host(summaries, [&](const auto& summary, const auto& host, const auto& threads) {
    Table table{.title = fmt::format("{}, threads on the {}", names.at(&summary), word(host)),
                .columns = {{"Role", left},
                            {"Name", left},
                            {"TID"},
                            {"Policy", left},
                            {"CPUs", left},
                            {"Faults\nminor/major"},
                            {"Switches\nvoluntary/not"},
                            {"CPU time\n(ms)"}}};
    for (const auto& thread : threads) table.rows.push_back(row(thread));
    page.tables.push_back(table);
  });
  if (page.tables.empty()) page.notes.emplace_back("No threads were recorded.");
  return page;
}

}  // namespace ontime::report

// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include <fmt/format.h>

#include "report/runs.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

using nlohmann::json;
using statistics::Distribution;
using statistics::Summary;
using Group = std::vector<const Summary*>;

std::string workers(const json& load) {
  std::vector<std::string> parts;
  for (const auto* kind : {"cpu", "vm", "io", "hdd"})
    if (count(at(load, kind)) > 0) parts.push_back(fmt::format("{} {}", count(at(load, kind)), kind));
  return join(parts, " ");
}

std::string load(const json& asked) {
  if (!asked.is_object()) return "";
  std::vector<std::string> hosts;
  for (const auto* host : {"controller", "component"})
    if (const auto text = workers(at(asked, host)); !text.empty()) hosts.push_back(text + " on the " + host);
  return hosts.empty() ? "no load" : "load: " + join(hosts, " and ");
}

std::string quality_of_service(const json& qos) {
  if (!qos.is_object()) return "";
  auto text = word(at(qos, "reliability")) + " " + word(at(qos, "history"));
  if (at(qos, "history") == "keep-last") text += " " + word(at(qos, "depth"));
  if (at(qos, "durability") != "volatile") text += " " + word(at(qos, "durability"));
  return text;
}

std::string seconds(const json& s) { return s.is_number() ? duration(s.get<double>() * 1e6) : nothing; }

bool any_refused(const Summary& summary) {
  const auto& hosts = at(summary.run.outcome, "hosts");
  return std::any_of(hosts.begin(), hosts.end(),
                     [](const json& host) { return !at(host, "refusals").empty(); });
}

// The conditions of a run in words, each for itself; nothing of what its record does not say.
std::vector<std::string> conditions(const Summary& summary) {
  const auto& asked = summary.run.asked;
  std::vector<std::string> phrases;
  const auto add = [&](const json& said, const std::string& phrase) {
    if (!said.is_null() && !phrase.empty()) phrases.push_back(phrase);
  };
  const auto& realtime = at(asked, "realtime");
  const auto& period = at(asked, "period_us");
  const auto& schedule = at(asked, "schedule");
  add(realtime, !is_true(realtime)     ? "SCHED_OTHER"
                : any_refused(summary) ? "real-time settings, not all given (see below)"
                                       : "real-time settings");
  add(at(asked, "payload_bytes"), size(at(asked, "payload_bytes")));
  if (schedule != "back-to-back") add(period, "every " + duration(period));
  add(schedule, word(schedule));
  if (at(asked, "deadline_us") != period)
    add(at(asked, "deadline_us"), "deadline " + duration(at(asked, "deadline_us")));
  add(at(asked, "qos"), quality_of_service(at(asked, "qos")));
  add(at(asked, "receive"), word(at(asked, "receive")));
  add(at(asked, "duration_s"), seconds(at(asked, "duration_s")));
  add(at(asked, "load"), load(at(asked, "load")));
  return phrases;
}

// Those phrases of the first run that all of the group share.
std::vector<std::string> shared_conditions(const Group& group) {
  auto shared = conditions(*group.front());
  for (const auto* summary : group) {
    const auto own = conditions(*summary);
    std::erase_if(shared,
                  [&](const auto& phrase) { return std::find(own.begin(), own.end(), phrase) == own.end(); });
  }
  return shared;
}

// What tells a run from the others of its group, repetition apart: its transport, and what is not shared.
std::string label(const Summary& summary, const std::vector<std::string>& shared) {
  const auto& asked = summary.run.asked;
  auto text = word(at(asked, "transport"));
  if (const auto variant = word(at(asked, "variant")); variant != nothing && !variant.empty())
    return text + " " + variant;
  for (const auto& phrase : conditions(summary))
    if (std::find(shared.begin(), shared.end(), phrase) == shared.end()) text += " " + phrase;
  return text;
}

std::vector<std::string> labels(const Group& group, const std::vector<std::string>& shared) {
  const bool repeated = std::any_of(group.begin(), group.end(), [](const auto* summary) {
    return count(at(summary->run.asked, "repetition")) > 1;
  });
  std::vector<std::string> labels;
  for (const auto* summary : group) {
    labels.push_back(label(*summary, shared));
    if (repeated) labels.back() += " #" + word(at(summary->run.asked, "repetition"));
  }
  std::map<std::string, int> uses;
  for (const auto& text : labels) ++uses[text];
  for (std::size_t i = 0; i < labels.size(); ++i)
    if (uses[labels[i]] > 1) labels[i] += fmt::format(" run {}", group[i]->run.number);
  return labels;
}

// A percentile needs one answer above it to say anything, and ten to be more than a glimpse: below that it is
// "-", or marked "~".
std::string percentile(const Distribution& of, std::int64_t ns, std::uint64_t one_in) {
  if (of.count < one_in) return nothing;
  const std::uint64_t above = of.count / one_in;
  return (above < 10 ? "~" : "") + microseconds(static_cast<double>(ns));
}

std::string share(std::uint64_t part, std::uint64_t whole) { return fmt::format("{}/{}", part, whole); }

std::vector<std::string> row(const std::string& label, const Summary& summary) {
  const auto& of = summary.round_trip;
  const auto value = [&](double ns) { return of.count == 0 ? nothing : microseconds(ns); };
  return {label,
          value(static_cast<double>(of.min)),
          value(of.mean),
          percentile(of, of.p50, 2),
          percentile(of, of.p90, 10),
          percentile(of, of.p99, 100),
          percentile(of, of.p99_9, 1000),
          percentile(of, of.p99_99, 10000),
          value(static_cast<double>(of.max)),
          share(summary.late, summary.sent),
          share(summary.lost, summary.sent)};
}

std::vector<Column> columns() {
  std::vector<Column> columns = {{"Round trip (µs)", Column::Align::left}};
  for (const auto* name :
       {"Min", "Avg", "p50", "p90", "p99", "p99.9", "p99.99", "Max", "Missed\ndeadlines", "Message\nloss"})
    columns.push_back({name});
  return columns;
}

Table table_of(Group group) {
  const auto shared = shared_conditions(group);
  // Interleaved repetitions come together again, in the order in which their first one ran.
  std::vector<std::string> order;
  for (const auto* summary : group) order.push_back(label(*summary, shared));
  const auto place = [&](const Summary* summary) {
    return std::find(order.begin(), order.end(), label(*summary, shared)) - order.begin();
  };
  std::stable_sort(group.begin(), group.end(),
                   [&](const auto* one, const auto* other) { return place(one) < place(other); });

  const auto& asked = group.front()->run.asked;
  Table table{word(at(asked, "id")), join(shared, ", "), columns(), {}, {}};
  if (const auto title = word(at(asked, "title")); title != nothing && !title.empty())
    table.title += "  " + title;
  const auto names = labels(group, shared);
  for (std::size_t i = 0; i < group.size(); ++i) {
    table.rows.push_back(row(names[i], *group[i]));
    if (const auto text = remarks(*group[i]); !text.empty()) table.notes.push_back(names[i] + ": " + text);
  }
  return table;
}

std::vector<Group> by_id(const Summaries& summaries) {
  std::vector<Group> groups;
  for (const auto& summary : summaries) {
    const auto same = std::find_if(groups.begin(), groups.end(), [&](const Group& group) {
      return at(group.front()->run.asked, "id") == at(summary.run.asked, "id");
    });
    if (same == groups.end())
      groups.push_back({&summary});
    else
      same->push_back(&summary);
  }
  return groups;
}

// "10 ms" if all runs have it, else `otherwise`.
std::string common_duration(const Summaries& summaries, const char* key, const std::string& otherwise) {
  const auto& first = at(summaries.front().run.asked, key);
  const bool common = std::all_of(summaries.begin(), summaries.end(),
                                  [&](const auto& summary) { return at(summary.run.asked, key) == first; });
  return common && first.is_number() ? duration(first) : otherwise;
}

std::string legend_of(const Page& page, const Summaries& summaries) {
  auto legend = fmt::format("Missed deadlines: answered later than {}. Message loss: not answered within {}.",
                            common_duration(summaries, "deadline_us", "the run's deadline"),
                            common_duration(summaries, "timeout_us", "the run's time-out"));
  const auto any_cell = [&](auto predicate) {
    return std::any_of(page.tables.begin(), page.tables.end(), [&](const Table& table) {
      return std::any_of(table.rows.begin(), table.rows.end(), [&](const auto& cells) {
        return std::any_of(cells.begin() + 1, cells.end(), predicate);
      });
    });
  };
  if (any_cell([](const std::string& cell) { return cell.starts_with('~'); }))
    legend += " ~: fewer than 10 answers were slower.";
  if (any_cell([](const std::string& cell) { return cell == nothing; }))
    legend += " -: too few answers to tell.";
  return legend;
}

}  // namespace

Page page_of(const Summaries& summaries) {
  if (summaries.empty()) return {{}, {"There are no runs."}, ""};
  Page page;
  for (const auto& group : by_id(summaries)) page.tables.push_back(table_of(group));
  page.notes = refusals(summaries);
  page.legend = legend_of(page, summaries);
  return page;
}

}  // namespace ontime::report

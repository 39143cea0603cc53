// SPDX-License-Identifier: Apache-2.0
// Runs set side by side.
// Ordinary thread; returns text, prints nothing.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "gate/gate.hpp"
#include "report/report.hpp"
#include "statistics/statistics.hpp"
#include "table/table.hpp"

namespace ontime::report {

// The runs of A and B with the same key, repetitions together, in A's order. Points into its arguments.
struct Comparison {
  using Runs = std::vector<const statistics::Summary*>;
  struct Pair {
    Runs from, to;
  };
  std::string from_name = "A", to_name = "B";  // for people: "Test1.B", "before.ontime", "threaded-napi off"
  std::string key;                             // that the sides differ in, of --by; else empty
  bool one_file = false;                       // the numbers of runs tell the sides apart
  std::vector<Pair> pairs;
  std::vector<Runs> only_from, only_to;  // those without a partner
};
Comparison compare(const std::vector<statistics::Summary>& a, const std::vector<statistics::Summary>& b);
// For chosen runs with different keys: pairs those with the same transports, options, receiving method and
// variant; or the only kind of each side.
Comparison compare_chosen(const std::vector<statistics::Summary>& a,
                          const std::vector<statistics::Summary>& b);
// Whether `ontime compare FILE --from A --to B` compares the runs of these two ids in one file, or of their
// numbers, if they have the same id.
bool can_compare(const std::vector<statistics::Summary>&, const statistics::Summary& from,
                 const statistics::Summary& to);
// For runs of one suite: those with the value `from` of a scenario's key (such as "kernel.threaded-napi")
// against those with the value `to`, everything else equal.
Comparison compare_by(const std::vector<statistics::Summary>&, const std::string& key,
                      const std::string& from, const std::string& to);
// The runs' values of a key, in the order of the runs; `unset` for runs without one.
inline constexpr const char* unset = "unset";
std::vector<std::string> values_of(const std::vector<statistics::Summary>&, const std::string& key);
// What a record has of a run that states nothing but this record's value of the key: defaults, and what
// follows from the value, such as the settings of `realtime: on`.
nlohmann::json following(const nlohmann::json& asked, const std::string& key);
// A value of a key in words, "10 ms", from a scenario's form, or from values_of(): "10000".
std::string words_of_value(const std::string& key, const std::string& value);
// Of several; those that would read the same stay as they are.
std::vector<std::string> words_of_values(const std::string& key, const std::vector<std::string>& values);

// The runs of one side without missing samples; the others are left out.
Comparison::Runs whole(const Comparison::Runs&);
// For whole runs. Nothing: one side does not have the metric.
std::optional<statistics::Change> change_of(const Comparison::Pair&, statistics::Times, statistics::Figure);
// Whether the interval is too wide to be shown to people: it holds both half and twice the value, or, of a
// share without a ratio, both 10 % of all messages less and 10 % more. A maximum has none anyway.
bool tells_nothing(statistics::Figure, const statistics::Change&);
bool is_repeated(const Comparison::Pair&);  // by two runs or more on each side
// The first one with other conditions than the first; nullptr: all have the same.
const statistics::Summary* unlike(const Comparison::Runs&);
bool has_run_on_both_sides(const Comparison::Pair&);  // of one file: by the numbers of the runs
// "a period and an age cannot be compared", where that leaves no pair. Empty: they can.
std::string why_never(const Comparison&);

// The answer first: what is proven to have changed, a row for each pair, what else is not the same.
std::string render_answer(Comparison, const std::vector<gate::Judgement>&, Format,
                          const std::string& full_command, std::size_t width);
// Each metric, how much it changed and the interval of the change; what else differs between the two sides;
// and what has no partner.
std::string render(const Comparison&, const std::vector<gate::Judgement>&, Format, std::size_t width = 100);

// A condition that differs between the sides, with both values; several values where repetitions have
// several. For whole runs; none if a side has no whole run.
struct Difference {
  std::string host;  // "controller", "component", or, of by_importance(), both; "": of the run
  std::string what;  // "kernel_release"
  std::string from, to;
  std::string text;  // for people, without the host: "period: 10 ms → 20 ms"

  static constexpr const char* both = "both";
  std::string name() const { return host.empty() ? what : host + ' ' + what; }
  // "controller kernel_release: 5.10 → 6.1"; of both hosts, "kernel_release: 5.10 → 6.1".
  std::string words() const { return host.empty() || host == both ? text : host + ' ' + text; }
};
std::vector<Difference> differences(const Comparison::Pair&);
// Without the comparison's key, and what follows from it.
std::vector<Difference> other_differences(const Comparison&, const Comparison::Pair&);
// What was requested first, then what an observer of two machines looks at. What is the same on both hosts is
// one difference.
std::vector<Difference> by_importance(const std::vector<Difference>&);
bool is_requested(const Difference&);

// Of runs of the same name, also what differs between them.
std::vector<std::string> names_apart(const std::vector<Comparison::Runs>&);

// What differs between repetitions, which share a row, though their numbers depend on it: "2 kernels: 5.10
// and 6.1".
std::vector<std::string> mixed(const Comparison::Runs&);
inline constexpr const char* come_from = "repetitions come from ";

// The keys of a scenario that are not the same in two runs: "deadline: 10 ms → 5 ms".
std::vector<std::string> key_differences(const statistics::Summary&, const statistics::Summary&);

table::Page page_of(const Comparison&, const std::vector<gate::Judgement>&);
nlohmann::ordered_json json_of(const Comparison&, const std::vector<gate::Judgement>&);
std::string csv_of(const Comparison&);

}  // namespace ontime::report

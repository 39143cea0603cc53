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

// Those of A and of B that have the same key, repetitions together, in A's order. It points into what was
// given.
struct Comparison {
  using Runs = std::vector<const statistics::Summary*>;
  struct Pair {
    Runs from, to;
  };
  std::string from_name = "A", to_name = "B";  // for people: "Test1.B", "before.ontime", "threaded-napi off"
  std::vector<Pair> pairs;
  std::vector<Runs> only_from, only_to;  // those without a partner
};
Comparison compare(const std::vector<statistics::Summary>& a, const std::vector<statistics::Summary>& b);
// Of runs that were chosen, whose keys differ: those whose conditions are the same in transports, options,
// what receives and what tells variants apart; or, if either side has only one kind, that.
Comparison compare_chosen(const std::vector<statistics::Summary>& a,
                          const std::vector<statistics::Summary>& b);
// Of runs of one suite: those with the value `from` of a scenario's key (such as "kernel.threaded-napi")
// against those with the value `to`, all else alike.
Comparison compare_by(const std::vector<statistics::Summary>&, const std::string& key,
                      const std::string& from, const std::string& to);
// The values that runs have of it, in the order of the runs; `unset` of those that have none.
inline constexpr const char* unset = "unset";
std::vector<std::string> values_of(const std::vector<statistics::Summary>&, const std::string& key);

// Of a side, the runs that do not lack samples: others are left out.
Comparison::Runs whole(const Comparison::Runs&);
// Of whole runs. Nothing: one of the sides does not have it.
std::optional<statistics::Change> change_of(const Comparison::Pair&, statistics::Times, statistics::Figure);
bool is_repeated(const Comparison::Pair&);            // by two runs or more on each side
bool has_run_on_both_sides(const Comparison::Pair&);  // of one file: by the numbers of the runs

// The answer first: what is proven to have changed, a row for each pair, what else is not the same.
std::string render_answer(const Comparison&, const std::vector<gate::Judgement>&, Format,
                          const std::string& full_command, std::size_t width);
// Each metric, how much it changed and the interval of the change; what else differs between the two sides;
// and what has no partner.
std::string render(const Comparison&, const std::vector<gate::Judgement>&, Format, std::size_t width = 100);

// What was not the same on both sides, beside what was measured: "controller kernel_release", and what it was
// on either; several values where repetitions have several. Of whole runs; none if a side has none.
struct Difference {
  std::string what, from, to;
};
std::vector<Difference> differences(const Comparison::Pair&);

// The keys of a scenario that are not the same in two runs: "deadline: 10 ms → 5 ms".
std::vector<std::string> key_differences(const statistics::Summary&, const statistics::Summary&);

table::Page page_of(const Comparison&, const std::vector<gate::Judgement>&);
nlohmann::ordered_json json_of(const Comparison&, const std::vector<gate::Judgement>&);
std::string csv_of(const Comparison&);

}  // namespace ontime::report

// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "fitness/look.hpp"
#include "table/table.hpp"

namespace ontime::fitness {
namespace {

struct Check {
  const char* name;
  Findings (*look)(const Look&);
};

constexpr Check checks[] = {{"preemption", preemption},
                            {"priority-limit", priority_limit},
                            {"priority-budget", priority_budget},
                            {"memory-limit", memory_limit},
                            {"rt-throttling", throttling},
                            {"fair-server", fair_server},
                            {"governor", governor},
                            {"idle-states", idle_states},
                            {"smt", smt},
                            {"isolated-cpus", isolation},
                            {"full-isolation", full_isolation},
                            {"virtual-machine", virtualisation},
                            {"stolen-time", stolen_time},
                            {"cpu-quota", cpu_quota},
                            {"clock-source", clock_source},
                            {"clock", clock_synchronised},
                            {"swap", swap},
                            {"huge-pages", huge_pages},
                            {"numa-balancing", memory_balancing},
                            {"compaction", compaction},
                            {"autogroup", autogroup},
                            {"timer-migration", timer_migration},
                            {"buffers", buffers},
                            {"fragments", fragments},
                            {"interrupts", interrupts},
                            {"irqbalance", interrupt_balance},
                            {"napi", napi},
                            {"middleware", middlewares}};

std::uint64_t count(const std::vector<Finding>& findings, Severity severity) {
  return static_cast<std::uint64_t>(std::ranges::count(findings, severity, &Finding::severity));
}

}  // namespace

const char* word_of(Severity severity) {
  return severity == Severity::wrong ? "error" : severity == Severity::hint ? "warning" : "ok";
}

std::vector<Finding> check(const Subject& subject) {
  const Look look(subject);
  std::vector<Finding> all;
  for (const auto& [name, function] : checks)
    for (auto& finding : function(look)) {
      finding.check = name;
      all.push_back(std::move(finding));
    }
  return all;
}

bool fit(const std::vector<Finding>& findings) { return count(findings, Severity::wrong) == 0; }

std::string counts_of(const std::vector<Finding>& findings) {
  return table::many(count(findings, Severity::wrong), "error", "errors") + ", " +
         table::many(count(findings, Severity::hint), "warning", "warnings");
}

}  // namespace ontime::fitness

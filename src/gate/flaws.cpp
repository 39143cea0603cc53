// SPDX-License-Identifier: Apache-2.0
// What makes a run unfit to be judged.
#include <algorithm>
#include <set>
#include <span>
#include <string_view>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "gate/gate.hpp"
#include "table/table.hpp"

namespace ontime::gate {

using statistics::Summary;

std::string absent(const record::Asked& asked, const record::Outcome& outcome) {
  const auto host_that = [&](auto&& is_meant) -> const char* {
    for (const auto* host : record::both_hosts)
      if (is_meant(record::find(outcome.hosts, host))) return host;
    return nullptr;
  };
  const auto did_not_last = [](const record::Applied& one) { return !one.lasted(); };
  if (const auto* host = host_that([](const record::Host& of) { return of.load_running == false; }))
    return fmt::format("the load on the {} had died by the end", host);
  for (const auto* host : record::both_hosts) {
    const auto& set = record::find(outcome.hosts, host).kernel;
    if (const auto found = std::find_if(set.begin(), set.end(), did_not_last); found != set.end())
      return fmt::format("kernel.{} on the {} did not keep the requested value", found->setting, host);
  }
  if (const auto* host = host_that([&](const record::Host& of) {
        return std::any_of(of.isolation.begin(), of.isolation.end(), did_not_last);
      }))
    return fmt::format("the requested CPUs and limits on the {} did not last to the end", host);
  if (const auto* host = host_that([](const record::Host& of) { return of.link.gone.has_value(); });
      host != nullptr && asked.faults.any())
    return fmt::format("the link faults on the {} were not verified to the end", host);
  for (const auto* way : record::both_ways) {
    if (record::find(outcome.traffic, way).is_short == true)
      return "traffic fell short of the requested rate";
    if (record::find(outcome.background, way).is_short)
      return "background topics fell short of the requested rate";
  }
  return "";
}

std::vector<SmallerLoad> smaller_loads(const record::Asked& asked, const record::Outcome& outcome) {
  std::vector<SmallerLoad> all;
  for (const auto& [name, load] : {std::pair(record::both_hosts[0], asked.controller_load),
                                   {record::both_hosts[1], asked.component_load}}) {
    const auto& host = record::find(outcome.hosts, name);
    // Until ontime noted what each worker was given, stress-ng divided the stated sizes among the workers.
    if (host.load_running && !host.load)
      for (const auto& [kind, bytes, workers] :
           {std::tuple("vm", load.vm_bytes, load.vm), {"hdd", load.hdd_bytes, load.hdd}})
        if (bytes > 0 && workers > 1)
          all.push_back({name, kind, bytes, bytes / static_cast<std::uint64_t>(workers), workers});
    // A file grows, and is begun anew: half of it is sure to be seen where it is ever written to its end.
    const auto given = host.load.value_or(record::GivenLoad());
    const auto &requested = given.hdd_bytes, &seen = given.hdd_file_bytes;
    if (requested && seen && *seen < *requested / 2) all.push_back({name, "hdd", *requested, *seen, 0});
  }
  return all;
}

std::vector<std::string> denied(const record::Outcome& outcome) {
  std::vector<std::string> all;
  std::set<std::string_view> known;  // a damaged file may have very many
  for (const auto& [name, host] : outcome.hosts)
    for (const auto& refusal : host.refusals)
      if (known.insert(refusal.asked).second) all.push_back(refusal.asked);
  return all;
}

bool ends_search(const record::Asked& asked, const record::Outcome& outcome) {
  if (!outcome.has_ended() || outcome.interrupted) return false;
  if (outcome.error) return outcome.unanswered && asked.step.number > 0;
  const auto& counted = outcome.counters;
  return counted.late + counted.lost + counted.skipped_cycles + outcome.late_by_response_only +
                 counted.dropped_records >
             0 ||
         counted.sent == 0 || !absent(asked, outcome).empty() || !smaller_loads(asked, outcome).empty();
}

Flaw flaw_of(const Summary& run) {
  const auto& asked = run.run.asked;
  const auto& outcome = run.run.outcome;
  if (run.imported) return Flaw::imported;
  if (!statistics::is_complete(run.run)) return outcome.error ? Flaw::failed : Flaw::cut_off;
  if (run.has_worst_only) return Flaw::worst_only;
  if (statistics::unrecorded(run.run) > 0) return Flaw::unrecorded;
  if (!record::misfit_of(asked, outcome).empty()) return Flaw::misfit;
  if (run.sent == 0) return Flaw::nothing_sent;
  if (!absent(asked, outcome).empty() || !smaller_loads(asked, outcome).empty()) return Flaw::absent;
  return denied(outcome).empty() ? Flaw::none : Flaw::denied;
}

std::string unfit(const Summary& run) {
  switch (flaw_of(run)) {
    case Flaw::imported:
      return "an imported histogram has no order in time, so only max is judged. Fix: limit max";
    case Flaw::failed:
      return "it failed: " + *run.run.outcome.error;
    case Flaw::cut_off:
      return "it was not measured to its end";
    case Flaw::worst_only:
      return "its file keeps only samples of the worst messages";
    case Flaw::unrecorded:
      return table::many(statistics::unrecorded(run.run), "of its samples was", "of its samples were") +
             " not recorded";
    case Flaw::misfit:
      return record::misfit_of(run.run.asked, run.run.outcome) + " has an invalid value";
    case Flaw::nothing_sent:
      return "nothing was sent";
    case Flaw::absent: {
      auto what = absent(run.run.asked, run.run.outcome);
      if (!what.empty()) return what;
      const auto load = smaller_loads(run.run.asked, run.run.outcome).front();
      return fmt::format("the {} load on the {} was smaller than requested", load.kind, load.host);
    }
    case Flaw::denied: {
      constexpr std::size_t most = 5;
      const auto all = denied(run.run.outcome);
      const auto some = std::span(all).first(std::min(most, all.size()));
      return fmt::format("denied: {:.80}", fmt::join(some, ", ")) +
             (all.size() > most ? fmt::format(" and {} more", all.size() - most) : "");
    }
    case Flaw::none:
      break;
  }
  return "";
}

}  // namespace ontime::gate

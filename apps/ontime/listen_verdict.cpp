// SPDX-License-Identifier: Apache-2.0
#include "listen_verdict.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "listen_chains.hpp"
#include "listen_words.hpp"
#include "terminal.hpp"

namespace ontime::app {

int exit_code_of(const listen::Findings& findings, const listen::Limits& limits,
                 const ListenArguments& arguments, bool is_all_seen) {
  const bool has_chain_limit =
      std::ranges::any_of(findings.chains, [](const auto& chain) { return chain.wish.age.has_value(); });
  // A bag is complete: what it has not by any name is no topic.
  if (!arguments.bag.empty() && !arguments.topics.empty() && findings.flows.empty() &&
      findings.forgotten.empty() && std::ranges::none_of(arguments.topics, [&](const auto& topic) {
        return findings.silent.contains(topic);
      }))
    return 2;
  // A silent topic misses every limit.
  if (!is_all_seen) return limits.any() || has_chain_limit ? 1 : 2;
  if (std::ranges::any_of(findings.chains, misses)) return 1;
  if (std::ranges::any_of(findings.chains,
                          [](const auto& chain) { return !chain.wish.age && came_out(chain) == 0; }))
    return 2;
  if (limits.any() && findings.flows.empty()) return 1;
  if (findings.all_forgotten().with_misses > 0) return 1;
  const auto lacks_age = [](const listen::Flow& flow) { return !open_age_of(flow).empty(); };
  if (const auto found = std::ranges::find_if(findings.flows, lacks_age);
      limits.age && found != findings.flows.end()) {
    print_error(fmt::format("open: --age {}: {}", arguments.age, open_age_of(*found)));
    return 1;
  }
  const auto lacks_periods = [](const listen::Flow& flow) {
    return flow.period.count() == 0 && (flow.not_judged > 0 || flow.messages > 1);
  };
  if (const auto found = std::ranges::find_if(findings.flows, lacks_periods);
      limits.longest_gap() && found != findings.flows.end()) {
    print_error(fmt::format("open: no period of {} is judged: {}", topic_of(found->topic),
                            found->not_judged > 0
                                ? "ontime was setting or removing probes. Fix: listen longer"
                                : "messages between those that were seen are unknown"));
    return 1;
  }
  return std::ranges::any_of(findings.flows,
                             [](const auto& flow) { return flow.late > 0 || flow.silent_ns > 0; })
             ? 1
             : 0;
}

}  // namespace ontime::app

// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include <fmt/format.h>

#include "listen_chains.hpp"
#include "listen_words.hpp"
#include "listening.hpp"
#include "spelling/spelling.hpp"
#include "table/table.hpp"
#include "terminal.hpp"

namespace ontime::app {
namespace {

std::string what_shows_topics(const ListenArguments& arguments) {
  if (arguments.reader) return "check the name and whether its writer runs: ros2 topic list";
  if (!arguments.bag.empty()) return "to list all topics of the bag, omit --topic";
  return arguments.chains.empty() ? "to list all topics, replace TOPIC by --list"
                                  : "to list all topics: ontime listen --list";
}

// The requested topic may be among flows without a topic name.
std::string what_names(std::size_t unnamed, const ListenArguments& arguments) {
  if (arguments.is_in_processes())
    return fmt::format(
        "{} no topic name: ontime finds that of a plain DDS program after some messages, or not at all. "
        "Listen longer, or list all flows: {}",
        table::many(unnamed, "flow has", "flows have"),
        arguments.chains.empty() ? "replace TOPIC by --list" : "ontime listen --list");
  return fmt::format(
      "{} no topic name, because their discovery was not captured. Start the capture before the nodes, or "
      "omit TOPIC",
      table::many(unnamed, "writer has", "writers have"));
}

}  // namespace

bool add_unseen(listen::Findings& findings, const std::set<std::string>& topics,
                const ListenArguments& arguments) {
  std::set<std::string> seen;
  for (const auto& flow : findings.flows) seen.insert(flow.topic);
  const auto unnamed =
      std::ranges::count_if(findings.flows, [](const auto& flow) { return flow.topic.empty(); });
  bool is_all_seen = true;
  for (const auto& topic : topics) {
    if (seen.contains(topic)) continue;
    is_all_seen = false;
    findings.remarks.push_back(fmt::format(
        "no message of '{}' was seen{}; {}", topic, spelling::suggestion(topic, {seen.begin(), seen.end()}),
        unnamed > 0 ? what_names(static_cast<std::size_t>(unnamed), arguments)
                    : what_shows_topics(arguments)));
  }
  if (findings.flows.empty() && arguments.is_in_processes())
    findings.remarks.emplace_back(
        "ontime watches the processes of this PID namespace that use ROS 2, Cyclone DDS or Fast DDS. For "
        "other programs: --packets any");
  if (!is_all_seen && arguments.is_in_processes())
    findings.remarks.emplace_back(
        "probes and packets do not show what nodes pass to each other within one process (ROS 2's "
        "intra-process "
        "communication). To see it: --reader");
  return is_all_seen;
}

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

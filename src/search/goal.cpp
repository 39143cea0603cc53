// SPDX-License-Identifier: Apache-2.0
#include "search/goal.hpp"

#include <algorithm>
#include <cmath>
#include <string_view>
#include <utility>

#include <fmt/format.h>

#include "search/measured.hpp"

namespace ontime::search {
namespace {

using statistics::Figure;

// The share of messages that may break the limit.
double permitted_share(const gate::Gate& gate) {
  if (gate.kind == gate::Gate::Limit::absolute && !statistics::metric_of(gate.figure).is_share &&
      gate.limit <= 0)
    throw gate::Error(fmt::format("'{}': the limit must be more than 0", gate.text));
  if (gate.figure == Figure::mean)
    throw gate::Error(
        fmt::format("'{}': a mean cannot be a goal, because it limits no single message. Use p50, p99 or max",
                    gate.text));
  if (gate.figure == Figure::max) return 0;
  if (const auto& metric = statistics::metric_of(gate.figure); metric.one_in > 0) return metric.share_above();
  if (gate.kind == gate::Gate::Limit::count && gate.limit > 0)
    throw gate::Error(
        fmt::format("'{}': a number of messages depends on the run's length. Use 0, or a share such as 0.1 %",
                    gate.text));
  return gate.limit;
}

// Of the text from there to there, without blanks at its ends.
Part part_of(const std::string& all, std::size_t from, std::size_t to) {
  from = std::min(all.find_first_not_of(" \t", from), to);
  const auto text = all.substr(from, to == from ? 0 : all.find_last_not_of(" \t", to - 1) + 1 - from);
  // On its own line: where it throws within braces, GCC 12 destroys what was initialized before it twice.
  auto parsed = gate::parse(text, gate::Use::goal, std::string_view(all).substr(0, from));
  const auto at = text.find_first_of("<=");
  const auto comparison = text.substr(at, text.find_first_not_of("<=", at) - at);
  if (comparison == "=" && parsed.limit != 0)
    throw gate::Error(fmt::format("'{}': = takes only 0; use < for other limits", text));
  if (comparison == "<" && parsed.limit == 0)
    throw gate::Error(fmt::format("'{}': nothing is less than 0. Use = 0", text));
  const auto share = permitted_share(parsed);
  return {{text, share}, std::move(parsed)};
}

}  // namespace

std::vector<Part> goal_of(const std::string& text) {
  constexpr std::string_view conjunction = " and ";
  std::vector<Part> parts;
  for (std::size_t from = 0; from <= text.size();) {
    const auto to = std::min(text.find(conjunction, from), text.size());
    parts.push_back(part_of(text, from, to));
    from = to == text.size() ? to + 1 : to + conjunction.size();
  }
  return parts;
}

// From against_at_least() with the alpha of the start.
double messages_to_prove(const Limit& limit, double of_run) {
  const double enough = std::log(2 / 0.0125);  // half of its weight is on a share of 0
  const auto expected = limit.share > 0 ? limit.share * of_run : 1;
  return enough * of_run * most_variation(limit) / std::log1p(expected * most_variation(limit));
}

Tally tally_of(const Part& part, const statistics::Summary& run) {
  // The upper bound: too few messages must not prove a goal.
  const auto of = gate::probability_beyond(part.gate, run).at_most;
  return {static_cast<double>(of.events), static_cast<double>(of.messages), std::max(of.effect, 1.0)};
}

}  // namespace ontime::search

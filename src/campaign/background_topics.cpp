// SPDX-License-Identifier: Apache-2.0
#include "campaign/background_topics.hpp"

#include <algorithm>

#include <fmt/format.h>

namespace ontime::campaign {
namespace {

using record::BackgroundSeen;
using record::BackgroundSent;

bool falls_short(std::uint64_t count, std::uint64_t asked, double share = 1) {
  return static_cast<double>(count) < record::enough_of_request * share * static_cast<double>(asked);
}

BackgroundSeen way(const BackgroundSent& sender, const BackgroundSent& receiver, std::uint64_t wanted,
                   double arriving) {
  const auto sent = sender.sent, received = receiver.received, overruns = receiver.overruns;
  const auto asked = std::max(sent + sender.refused + sender.skipped_cycles, wanted);
  return {.sent = sent,
          .received = received,
          .lost = sent - std::min(sent, received),
          // A sender that has not finished has not counted all.
          .skipped_cycles = asked - sent - sender.refused,
          .refused = sender.refused,
          .overruns = overruns,
          .strays = receiver.strays,
          .is_short = falls_short(sent, asked) || falls_short(received, asked, arriving) ||
                      falls_short(received - std::min(received, overruns), received)};
}

// Where the missing messages are.
std::string missing(const BackgroundSeen& counted) {
  std::string text;
  for (const auto& [count, what] :
       {std::pair(counted.skipped_cycles, "; {} not sent because their sender overran its period"),
        {counted.refused, "; {} refused by the transport"},
        {counted.lost, "; {} lost"}})
    if (count > 0) text += fmt::format(fmt::runtime(what), count);
  return text;
}

}  // namespace

agent::Task of_their_own(agent::Task task) {
  task.realtime = {};
  task.count_instructions = false;
  return task;
}

record::ByName<BackgroundSeen> achieved(const roundtrip::BackgroundOptions& options,
                                        const record::Outcome& outcome,
                                        std::optional<std::chrono::nanoseconds> duration, double arriving) {
  const auto& controller = find(outcome.hosts, "controller").background;
  const auto& component = find(outcome.hosts, "component").background;
  const auto wanted = duration ? roundtrip::messages_asked(options, *duration) : 0;
  record::ByName<BackgroundSeen> all;
  if (options.there) all["to_component"] = way(controller, component, wanted, arriving);
  if (options.back) all["to_controller"] = way(component, controller, wanted, arriving);
  return all;
}

std::vector<std::string> shortfalls_of_background(const record::ByName<BackgroundSeen>& achieved) {
  std::vector<std::string> texts;
  for (const auto& [way, counted] : achieved)
    if (counted.is_short)
      texts.push_back(fmt::format(
          "BACKGROUND TOPICS SHORTFALL: {} of {} messages arrived at the {}{}{}", counted.received,
          counted.sent + counted.refused + counted.skipped_cycles,
          way == "to_component" ? "component" : "controller",
          counted.overruns == 0
              ? ""
              : fmt::format("; {} with a callback longer than its share of the period", counted.overruns),
          missing(counted)));
  return texts;
}

}  // namespace ontime::campaign

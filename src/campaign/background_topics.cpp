// SPDX-License-Identifier: Apache-2.0
#include "campaign/background_topics.hpp"

#include <algorithm>

#include <fmt/format.h>

namespace ontime::campaign {
namespace {

using nlohmann::json;

constexpr double enough_messages = 0.95;  // of the requested messages, as for traffic

bool falls_short(std::uint64_t count, std::uint64_t asked) {
  return static_cast<double>(count) < enough_messages * static_cast<double>(asked);
}

json way(const json& sender, const json& receiver, std::uint64_t wanted) {
  const auto sent = sender.at("sent").get<std::uint64_t>();
  const auto received = receiver.at("received").get<std::uint64_t>();
  const auto refused = sender.at("refused").get<std::uint64_t>();
  const auto overruns = receiver.at("overruns").get<std::uint64_t>();
  const auto asked = std::max(sent + refused + sender.at("skipped_cycles").get<std::uint64_t>(), wanted);
  const auto skipped = asked - sent - refused;  // a sender that has not finished has not counted all
  const bool is_short = falls_short(sent, asked) || falls_short(received, asked) ||
                        falls_short(received - std::min(received, overruns), received);
  return {{"sent", sent},         {"received", received},      {"lost", sent - std::min(sent, received)},
          {"refused", refused},   {"skipped_cycles", skipped}, {"strays", receiver.at("strays")},
          {"overruns", overruns}, {"short", is_short}};
}

// Where the missing messages are.
std::string missing(const json& counted) {
  const struct {
    const char *key, *what;
  } places[] = {{"skipped_cycles", "; {} not sent because their sender overran its period"},
                {"refused", "; {} refused by the transport"},
                {"lost", "; {} lost"}};
  std::string text;
  for (const auto& [key, what] : places)
    if (const auto count = counted.at(key).get<std::uint64_t>(); count > 0)
      text += fmt::format(fmt::runtime(what), count);
  return text;
}

}  // namespace

agent::Task of_their_own(agent::Task task) {
  task.realtime = {};
  task.count_instructions = false;
  return task;
}

json achieved(const roundtrip::BackgroundOptions& options, const json& outcome,
              std::optional<std::chrono::nanoseconds> duration) {
  const auto& controller = outcome.at("hosts").at("controller").at("neighbours");
  const auto& component = outcome.at("hosts").at("component").at("neighbours");
  const auto wanted = duration ? roundtrip::messages_asked(options, *duration) : 0;
  auto all = json::object();
  if (options.there) all["to_component"] = way(controller, component, wanted);
  if (options.back) all["to_controller"] = way(component, controller, wanted);
  return all;
}

std::vector<std::string> shortfalls_of_background(const json& achieved) {
  std::vector<std::string> texts;
  for (const auto& [way, counted] : achieved.items()) {
    if (!counted.at("short")) continue;
    const auto of = [&counted = counted](const char* key) { return counted.at(key).get<std::uint64_t>(); };
    texts.push_back(fmt::format(
        "BACKGROUND TOPICS SHORTFALL: {} of {} messages arrived at the {}{}{}", of("received"),
        of("sent") + of("refused") + of("skipped_cycles"), way == "to_component" ? "component" : "controller",
        of("overruns") == 0
            ? ""
            : fmt::format("; {} with a callback longer than its share of the period", of("overruns")),
        missing(counted)));
  }
  return texts;
}

}  // namespace ontime::campaign

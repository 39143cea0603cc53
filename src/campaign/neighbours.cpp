// SPDX-License-Identifier: Apache-2.0
#include "campaign/neighbours.hpp"

#include <algorithm>

#include <fmt/format.h>

namespace ontime::campaign {
namespace {

using nlohmann::json;

constexpr double enough = 0.95;  // of what was asked, as of traffic

json way(const json& sender, const json& receiver, double wanted) {
  const auto sent = sender.at("sent").get<std::uint64_t>();
  const auto received = receiver.at("received").get<std::uint64_t>();
  const auto refused = sender.at("refused").get<std::uint64_t>();
  auto skipped = sender.at("skipped_cycles").get<std::uint64_t>();
  const auto asked = std::max(static_cast<double>(sent + refused + skipped), wanted);
  const auto overruns = receiver.at("overruns").get<std::uint64_t>();
  const bool too_few = static_cast<double>(sent) < enough * asked;
  const bool is_short =
      too_few || static_cast<double>(overruns) > (1 - enough) * static_cast<double>(received);
  // One that has not run until its end has not seen what it skipped.
  if (too_few)
    skipped = std::max(skipped, static_cast<std::uint64_t>(asked) -
                                    std::min(static_cast<std::uint64_t>(asked), sent + refused));
  return {{"sent", sent},         {"received", received},      {"lost", sent - std::min(sent, received)},
          {"refused", refused},   {"skipped_cycles", skipped}, {"strays", receiver.at("strays")},
          {"overruns", overruns}, {"short", is_short}};
}

}  // namespace

json achieved(const roundtrip::NeighbourOptions& options, const json& outcome,
              std::optional<std::chrono::nanoseconds> duration) {
  const auto& controller = outcome.at("hosts").at("controller").at("neighbours");
  const auto& component = outcome.at("hosts").at("component").at("neighbours");
  const double wanted =
      duration ? options.topics * (std::chrono::duration<double>(*duration) / options.period) : 0;
  auto all = json::object();
  if (options.there) all["to_component"] = way(controller, component, wanted);
  if (options.back) all["to_controller"] = way(component, controller, wanted);
  return all;
}

std::vector<std::string> shortfalls_of_neighbours(const json& achieved) {
  std::vector<std::string> texts;
  for (const auto& [name, counted] : achieved.items())
    if (counted.at("short"))
      texts.push_back(fmt::format(
          "the neighbours that were asked for were NOT there: {} messages went to the {}, {} did not, "
          "for their sender overran its period, and {} were refused by the transport; {} arrived, and of "
          "these {} had a callback that took longer than its turn",
          counted.at("sent").get<std::uint64_t>(), name == "to_component" ? "component" : "controller",
          counted.at("skipped_cycles").get<std::uint64_t>(), counted.at("refused").get<std::uint64_t>(),
          counted.at("received").get<std::uint64_t>(), counted.at("overruns").get<std::uint64_t>()));
  return texts;
}

}  // namespace ontime::campaign

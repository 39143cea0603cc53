// SPDX-License-Identifier: Apache-2.0
#include "campaign/link.hpp"

#include <algorithm>
#include <tuple>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "message/message.hpp"

namespace ontime::campaign {
namespace {

using nlohmann::json;

// A thread may have sent an answer, and be kept from counting it.
constexpr std::uint64_t uncounted = 1;

std::string segments(const json& host) {
  const auto names = host.value("shared_memory", std::vector<std::string>{});
  return names.empty() ? "" : fmt::format("; this end uses shared memory ({})", fmt::join(names, ", "));
}

// Bytes of background topics that this end certainly received.
std::uint64_t background_bytes(const json& outcome, const char* receiver) {
  const auto background = outcome.at("hosts").value(receiver, json::object()).value("neighbours", json());
  if (background.is_null()) return 0;
  return background.at("received").get<std::uint64_t>() *
         message::least_frame_bytes(background.at("payload_bytes").get<std::uint64_t>());
}

bool one_machine_with_shared_memory(const json& hosts) {
  if (hosts.size() < 2) return false;
  json boot;
  for (const auto& host : hosts) {
    const auto& own = host.at("machine").value("boot_id", json());
    if (host.at("link").is_null() || host.at("shared_memory").empty() || own.is_null()) return false;
    if (!boot.is_null() && own != boot) return false;
    boot = own;
  }
  return true;
}

}  // namespace

std::optional<std::string> went_elsewhere(const json& outcome, std::uint64_t payload_bytes) {
  const auto count = [&](const char* key) { return outcome.at(key).get<std::uint64_t>(); };
  // Answered messages certainly passed each end in both directions. A lost message may have been dropped
  // before the kernel counts it: by a queue, or because the link was down.
  const auto answered = count("on_time") + count("late");
  const auto component = outcome.at("hosts").value("component", json::object());
  const auto by_component = component.value("answered", answered);
  const bool again = component.value("started_again", false);  // it has counted since then
  if (!again && by_component + uncounted < answered)
    return fmt::format(
        "the component answered {} messages, but {} answers arrived: another program uses its address or its "
        "topics. The results do not measure this component",
        by_component, answered);
  for (const auto& [name, host] : outcome.at("hosts").items()) {
    const auto& link = host.at("link");
    if (link.is_null()) continue;
    const auto own = name == "component" && again ? std::min(answered, by_component) : answered;
    const auto* const other = name == "component" ? "controller" : "component";
    for (const auto& [key, verb, receiver] :
         {std::tuple("sent_bytes", "sent", other), std::tuple("received_bytes", "received", name.c_str())}) {
      const auto counted = link.value("beside_traffic", link);
      if (!counted.contains(key)) continue;  // unproved() says so
      const auto carried = counted.at(key).get<std::uint64_t>();
      const auto beside = background_bytes(outcome, receiver);
      if (carried >= own * message::least_frame_bytes(payload_bytes) + beside) continue;
      return fmt::format(
          "the data did not go over {}: {} messages of {} bytes were answered{}, but the kernel counted only "
          "{} bytes {} there by the {}{}. The results do not measure this link",
          link.at("interface").get<std::string>(), own, payload_bytes,
          beside > 0 ? fmt::format(" and {} bytes of background topics received", beside) : "", carried, verb,
          name, segments(host));
    }
  }
  if (one_machine_with_shared_memory(outcome.at("hosts")))
    return fmt::format(
        "both ends are on one machine and their middleware uses shared memory ({}). The data may have "
        "bypassed the requested interface. Fix: disable the shared-memory transport in the middleware's "
        "configuration",
        fmt::join(outcome.at("hosts").at("controller").at("shared_memory").get<std::vector<std::string>>(),
                  ", "));
  return {};
}

std::optional<std::string> went_past_etf(const json& outcome) {
  const auto count = [&](const char* key) { return outcome.at(key).get<std::uint64_t>(); };
  for (const auto& [name, host] : outcome.at("hosts").items()) {
    const auto messages = name == "component" ? host.at("answered").get<std::uint64_t>()
                                              : count("sent") - count("refused_sends");
    const auto& link = host.at("link");
    if (link.is_null() || link.contains("gone")) continue;  // unproved() says so
    const auto etf = link.value("etf", json::object());
    // Frames that the etf dropped count as lost messages, and may belong to another program.
    const auto launched = etf.value("launched_frames", std::uint64_t{0});
    if (launched + count("lost") + uncounted >= messages) continue;
    return fmt::format(
        "launch-time was not applied: the {} sent {} messages, but the etf qdisc of its interface passed on "
        "{} frames. Fix: set link.message-priority to the class of the etf",
        name, messages, launched);
  }
  return {};
}

std::optional<std::string> unproved(const json& outcome, const std::set<std::string>& with_traffic) {
  for (const auto& [name, host] : outcome.at("hosts").items()) {
    const auto& link = host.at("link");
    if (link.is_null() || link.contains("beside_traffic")) continue;
    if (link.contains("gone"))
      return fmt::format("not verified that the messages used {}: on the {}, {}",
                         link.at("interface").get<std::string>(), name, link.at("gone").get<std::string>());
    if (with_traffic.contains(name))
      return fmt::format(
          "not verified that the messages used {}: the {} cannot count them apart from the traffic. Needed: "
          "an IP transport, root, nftables, and command prefix [ip, netns, exec, NAME] or none",
          link.at("interface").get<std::string>(), name);
  }
  return {};
}

}  // namespace ontime::campaign

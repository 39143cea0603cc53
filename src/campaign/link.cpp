// SPDX-License-Identifier: Apache-2.0
#include "campaign/link.hpp"

#include <algorithm>
#include <tuple>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "message/message.hpp"

namespace ontime::campaign {
namespace {

using record::Outcome;

// A thread may have sent an answer, and be kept from counting it.
constexpr std::uint64_t uncounted = 1;

std::string segments(const record::Host& host) {
  return host.shared_memory.empty()
             ? ""
             : fmt::format("; this end uses shared memory ({})", fmt::join(host.shared_memory, ", "));
}

// Bytes of background topics that this end certainly received.
std::uint64_t background_bytes(const Outcome& outcome, const std::string& receiver) {
  const auto& background = find(outcome.hosts, receiver).background;
  return background.received * message::least_frame_bytes(background.payload_bytes);
}

bool one_machine_with_shared_memory(const Outcome& outcome) {
  return on_one_machine(outcome) && std::ranges::all_of(outcome.hosts, [](const auto& host) {
           return !host.second.link.interface.empty() && !host.second.shared_memory.empty();
         });
}

}  // namespace

std::optional<std::string> at_another(const std::vector<Claim>& claims) {
  const auto has = [](const Claim& claim, const std::string& address) {
    return std::ranges::count(claim.owned, address) > 0;
  };
  for (const auto& claim : claims) {
    if (has(claim, claim.stated)) continue;
    const auto other = std::ranges::find_if(claims, [&](const auto& one) { return has(one, claim.stated); });
    if (other == claims.end()) continue;
    const auto of = claim.ssh.empty() ? claim.component : claim.ssh;
    auto owned = claim.owned;
    std::erase_if(owned, [](const auto& address) { return address.starts_with("127."); });
    return fmt::format("{}: {} is not an address of {}, but of {}. Fix: address of {}: {}", claim.component,
                       claim.stated, of, other->component, claim.component, fmt::join(owned, " or "));
  }
  return {};
}

std::optional<std::string> went_elsewhere(const Outcome& outcome, std::uint64_t payload_bytes) {
  // Answered messages certainly passed each end in both directions. A lost message may have been dropped
  // before the kernel counts it: by a queue, or because the link was down.
  const auto answered = outcome.counters.on_time + outcome.counters.late;
  const auto& component = find(outcome.hosts, "component");
  const auto by_component = component.answered.value_or(answered);
  if (!component.started_again && by_component + uncounted < answered)
    return fmt::format(
        "the component answered {} messages, but {} answers arrived: another program uses its address or its "
        "topics. The results do not measure this component",
        by_component, answered);
  for (const auto& [name, host] : outcome.hosts) {
    const auto& link = host.link;
    if (link.interface.empty()) continue;
    const auto own = host.started_again ? std::min(answered, by_component) : answered;
    const auto counted = link.beside_traffic.value_or(record::Carried{link.sent_bytes, link.received_bytes});
    for (const auto& [carried, verb, receiver] :
         {std::tuple(counted.sent_bytes, "sent", name == "component" ? "controller" : "component"),
          std::tuple(counted.received_bytes, "received", name.c_str())}) {
      if (!carried) continue;  // unproved() says so
      const auto beside = background_bytes(outcome, receiver);
      if (*carried >= own * message::least_frame_bytes(payload_bytes) + beside) continue;
      return fmt::format(
          "the data did not go over {}: {} messages of {} bytes were answered{}, but the kernel counted only "
          "{} bytes {} there by the {}{}. The results do not measure this link",
          link.interface, own, payload_bytes,
          beside > 0 ? fmt::format(" and {} bytes of background topics received", beside) : "", *carried,
          verb, name, segments(host));
    }
  }
  if (one_machine_with_shared_memory(outcome))
    return fmt::format(
        "both ends are on one machine and their middleware uses shared memory ({}). The data may have "
        "bypassed the requested interface. Fix: disable the shared-memory transport in the middleware's "
        "configuration",
        fmt::join(find(outcome.hosts, "controller").shared_memory, ", "));
  return {};
}

std::optional<std::string> went_past_etf(const Outcome& outcome) {
  const auto& counted = outcome.counters;
  for (const auto& [name, host] : outcome.hosts) {
    const auto messages =
        name == "component" ? host.answered.value_or(0) : counted.sent - counted.refused_sends;
    if (host.link.interface.empty() || host.link.gone) continue;  // unproved() says so
    // Frames that the etf dropped count as lost messages, and may belong to another program.
    const auto launched = host.link.etf.value_or(record::Etf()).launched_frames;
    if (launched + counted.lost + uncounted >= messages) continue;
    return fmt::format(
        "launch-time was not applied: the {} sent {} messages, but the etf qdisc of its interface passed on "
        "{} frames. Fix: set link.message-priority to the class of the etf",
        name, messages, launched);
  }
  return {};
}

std::optional<std::string> unproved(const Outcome& outcome, const std::set<std::string>& with_traffic) {
  for (const auto& [name, host] : outcome.hosts) {
    const auto& link = host.link;
    if (link.interface.empty() || link.beside_traffic) continue;
    if (link.gone)
      return fmt::format("not verified that the messages used {}: on the {}, {}", link.interface, name,
                         *link.gone);
    if (with_traffic.contains(name))
      return fmt::format(
          "not verified that the messages used {}: the {} cannot count them apart from the traffic. Needed: "
          "an IP transport, root, nftables, and command prefix [ip, netns, exec, NAME] or none",
          link.interface, name);
  }
  return {};
}

}  // namespace ontime::campaign

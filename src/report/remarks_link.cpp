// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <optional>
#include <string_view>
#include <utility>

#include <fmt/format.h>

#include "report/runs.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

using record::find;
using record::Outcome;

template <typename Struct>
struct Counter {
  std::uint64_t Struct::*counter;
  const char* what;
};

// The end that "to_component" leads to.
std::string_view end_of(std::string_view way) { return way.substr(sizeof("to_") - 1); }

Remark by_shortfall(const char* shortfall, const char* else_, bool is_short,
                    const std::vector<std::string>& ways) {
  if (ways.empty()) return {};
  return {is_short ? Remark::Weight::not_applied : Remark::Weight::detail,
          (is_short ? shortfall : else_) + join(ways, ", ")};
}

// The interface's own counters show more than was measured. (Too little makes a run fail.)
constexpr std::uint64_t headers_bytes = 120;  // of a message, at most: Ethernet, IP, UDP, RTPS
constexpr std::uint64_t much = 10;            // times what the messages take
constexpr std::uint64_t little_bytes = 1 << 20;
// The payload of the requested traffic.
std::uint64_t traffic_bytes(const statistics::Summary& summary) {
  double bits = 0;
  for (const auto& [way, rates] : summary.run.outcome.traffic)
    bits += std::max(0.0, rates.sent_bit_s.value_or(0));
  const auto seconds = static_cast<double>(summary.run.asked.task.client.duration.count()) / 1e9;
  return static_cast<std::uint64_t>(std::clamp(bits / 8 * seconds, 0.0, 1e15));
}
// Bounded, so that sizes and counts of a damaged file can be multiplied.
std::uint64_t bounded(std::uint64_t number) { return std::min<std::uint64_t>(number, 1 << 30); }
std::uint64_t background_bytes(const statistics::Summary& summary) {
  std::uint64_t bytes = 0;
  for (const auto& [name, host] : summary.run.outcome.hosts)
    bytes += bounded(host.background.sent) * (bounded(host.background.payload_bytes) + headers_bytes);
  return bytes;
}

}  // namespace

std::string losses_text(const Outcome& outcome, std::optional<std::uint64_t> record::Losses::*kind,
                        const char* where) {
  std::vector<std::string> parts;
  for (const auto* host : record::both_hosts)
    if (const auto number = (find(outcome.hosts, host).losses.*kind).value_or(0); number > 0)
      parts.push_back(fmt::format("{} {} the {}", number, where, host));
  return join(parts, ", ");
}

// The achieved concurrent traffic; in capitals if less than requested.
Remark traffic_remark(const Outcome& outcome) {
  std::vector<std::string> ways;
  bool any_short = false;
  for (const auto& [way, rates] : outcome.traffic) {
    const bool is_short = rates.is_short == true;
    any_short = any_short || is_short;
    ways.push_back(fmt::format("{} Mbit/s of {} arrived at the {}{}", megabits(rates.received_bit_s),
                               megabits(rates.asked_bit_s), end_of(way),
                               is_short ? fmt::format(" ({} sent)", megabits(rates.sent_bit_s)) : ""));
  }
  return by_shortfall("TRAFFIC SHORTFALL: ", "traffic: ", any_short, ways);
}

// The background topics' messages, of those requested; in capitals if it is short of them.
Remark background_remark(const Outcome& outcome) {
  using Seen = record::BackgroundSeen;
  static constexpr Counter<Seen> others[] = {
      {&Seen::lost, "{} lost"},
      {&Seen::skipped_cycles, "{} not sent because their sender overran its period"},
      {&Seen::refused, "{} refused by the transport"},
      {&Seen::overruns, "{} with a callback that took longer than its turn"},
      {&Seen::strays, "{} of another sender"}};
  std::vector<std::string> ways;
  bool any_short = false;
  for (const auto& [way, seen] : outcome.background) {
    any_short = any_short || seen.is_short;
    const auto text = fmt::format("{} of {} arrived at the {}", grouped(seen.received),
                                  grouped(seen.sent + seen.refused + seen.skipped_cycles), end_of(way));
    std::vector<std::string> details;
    for (const auto& [counter, what] : others)
      if (const auto number = seen.*counter; number > 0)
        details.push_back(fmt::format(fmt::runtime(what), grouped(number)));
    ways.push_back(details.empty() ? text : text + " (" + join(details, ", ") + ")");
  }
  return by_shortfall("BACKGROUND TOPICS SHORTFALL: ", "background topics: ", any_short, ways);
}

// Where the kernel dropped packets.
std::string drops_text(const Outcome& outcome) {
  using Drops = record::Drops;
  static constexpr Counter<Drops> places[] = {
      {&Drops::own_sockets, "{} because a socket buffer of the {}'s middleware was full"},
      {&Drops::udp_receive, "{} because a UDP socket buffer on the {} was full (any process)"},
      {&Drops::udp_send, "{} that the {}'s sockets could not send"},
      {&Drops::fragments, "{} on the {} because fragments were missing"},
      {&Drops::interface_received, "{} on receive by the {}'s interface"},
      {&Drops::interface_sent, "{} on send by the {}'s interface"},
      {&Drops::backlog, "{} in the {}'s CPU backlog queues (whole machine)"}};
  std::vector<std::string> parts;
  for (const auto* host : record::both_hosts) {
    const auto& dropped = find(outcome.hosts, host).drops;
    for (const auto& [counter, what] : places) {
      const auto number = dropped.*counter;
      if (number == 0) continue;
      if (counter == &Drops::udp_receive && number == dropped.own_sockets) continue;
      parts.push_back(fmt::format(fmt::runtime(what), number, host));
    }
  }
  return parts.empty() ? "" : "dropped by the kernel: " + join(parts, ", ");
}

// Losses that ontime itself caused: "link.loss dropped 51 frames to the component".
std::string link_faults_text(const Outcome& outcome) {
  using Faults = record::LinkFaults;
  static constexpr Counter<Faults> kinds[] = {
      {&Faults::lost_frames, "link.loss dropped {} to the {}"},
      {&Faults::cut_off_frames, "link.cut dropped {} to the {}"},
      {&Faults::duplicated_frames, "link.duplicate sent {} of the {} twice"}};
  std::vector<std::string> parts;
  for (const auto& [counter, what] : kinds)
    for (const auto* host : record::both_hosts)
      if (const auto frames = find(outcome.hosts, host).link.faults.value_or(Faults()).*counter; frames > 0)
        parts.push_back(fmt::format(fmt::runtime(what), many(frames, "frame", "frames"), host));
  return join(parts, ", ");
}

// "etf dropped 3 frames of the controller: launch time passed or missing".
std::string missed_launches_text(const Outcome& outcome) {
  std::vector<std::string> parts;
  for (const auto* host : record::both_hosts)
    if (const auto frames = find(outcome.hosts, host).link.etf.value_or(record::Etf()).dropped_frames;
        frames > 0)
      parts.push_back(fmt::format("{} of the {}", many(frames, "frame", "frames"), host));
  return parts.empty() ? "" : fmt::format("etf dropped {}: launch time passed or missing", join(parts, ", "));
}

std::vector<std::string> other_traffic(const statistics::Summary& summary) {
  // Of other components, which may share the interface, only the outcome of their own runs tells how much it
  // was, unless they send as many bytes as this one.
  const auto& others = summary.run.asked.others;
  if (others.traffic || others.topics || others.messages) return {};
  const auto messages = (1 + std::min<std::uint64_t>(others.components, 1000)) * summary.sent;
  const auto expected =
      2 * messages * (bounded(summary.run.asked.task.client.payload_bytes) + headers_bytes) +
      traffic_bytes(summary) + background_bytes(summary);
  std::vector<std::string> parts;
  std::optional<std::pair<std::string, std::string>> seen;  // both ends of loopback are one interface
  for (const auto* host : record::both_hosts) {
    const auto& of = find(summary.run.outcome.hosts, host);
    const auto bytes = of.link.bytes();
    const std::pair which(of.link.interface, of.machine.boot_id);
    if (bytes / much <= expected || bytes < little_bytes || which == seen) continue;
    seen = which;
    parts.push_back(fmt::format(
        "other traffic on {} of the {}: {:.0f} MB in total, the requested traffic takes {:.1f} MB",
        word(of.link.interface), host, static_cast<double>(bytes) / 1e6,
        static_cast<double>(expected) / 1e6));
  }
  return parts;
}

}  // namespace ontime::report

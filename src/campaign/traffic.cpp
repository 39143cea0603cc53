// SPDX-License-Identifier: Apache-2.0
#include "campaign/traffic.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>

#include <fmt/format.h>

#include "table/table.hpp"

namespace ontime::campaign {
namespace {

using nlohmann::json;

constexpr const char* to_component = "to_component";
constexpr const char* to_controller = "to_controller";
constexpr int first_port = 5201;  // iperf3's own, which firewalls know

std::optional<double> rate_of(const json& by_host, const char* host, const std::string& way) {
  const auto rate = by_host.value(host, json::object()).value(way, json::object()).value("bit_s", json());
  return rate.is_number() ? std::optional(rate.get<double>()) : std::nullopt;
}

bool running(const json& by_host, const std::string& way) {
  for (const auto* host : {"controller", "component"})
    if (!by_host.value(host, json::object()).value(way, json::object()).value("running", false)) return false;
  return true;
}

std::uint64_t frames_of(std::uint64_t datagram_bytes) {
  constexpr std::uint64_t header_bytes = 8, frame_bytes = 1480;  // of UDP; in an Ethernet frame beside IP's
  return (datagram_bytes + header_bytes + frame_bytes - 1) / frame_bytes;
}

std::string megabits(const std::optional<double>& bit_s) {
  return bit_s ? table::megabits(*bit_s) : "unknown";
}

}  // namespace

std::vector<int> ports_of(const Together& runs) {
  if (std::ranges::none_of(runs, [](const Run& run) { return run.traffic.any(); })) return {};
  return {first_port, first_port + 1};
}

std::vector<std::string> ways_of(const Traffic& traffic) {
  std::vector<std::string> ways;
  if (traffic.bits_per_s == 0) return ways;
  if (traffic.direction != Traffic::Direction::to_controller) ways.emplace_back(to_component);
  if (traffic.direction != Traffic::Direction::to_component) ways.emplace_back(to_controller);
  return ways;
}

// The component is the iperf3 server in both directions, so only its address is needed.
background::Stream stream_of(const Run& run, const std::string& way, const std::string& end,
                             const Hosts& hosts) {
  const auto& traffic = run.traffic;
  const bool serves = end == run.component;
  const auto& host = hosts.at(end);
  return {.place = host.command_prefix,
          .serves = serves,
          .receives = way == to_controller,
          .address = without_port(hosts.at(run.component).address),
          .interface = host.interface,
          .port = first_port + (way == to_controller ? 1 : 0),
          .bits_per_s = traffic.bits_per_s,
          .datagram_bytes = traffic.datagram_bytes,
          .priority = traffic.priority};
}

// A datagram needs all its frames.
double share_that_arrives(const Run& run, std::chrono::nanoseconds lasted, std::uint64_t datagram_bytes,
                          bool is_reliable) {
  const auto share =
      is_reliable ? 1 : std::pow(1 - run.faults.loss, static_cast<double>(frames_of(datagram_bytes)));
  const std::chrono::duration<double> whole = lasted;
  if (!run.cut || whole.count() <= 0) return share;
  const std::chrono::duration<double> at = run.cut->at, length = run.cut->length;
  return share * (1 - std::clamp((whole - at) / whole, 0.0, length / whole));
}

record::ByName<record::TrafficSeen> achieved(const Run& run, std::chrono::nanoseconds lasted,
                                             const json& by_host) {
  const auto& traffic = run.traffic;
  // iperf3 counts a copy of a datagram, too. Copies of fragments make no datagram.
  const double copies = frames_of(traffic.datagram_bytes) == 1 ? 1 + run.faults.duplicates : 1;
  const double enough = record::enough_of_request * copies *
                        share_that_arrives(run, lasted, traffic.datagram_bytes) *
                        static_cast<double>(traffic.bits_per_s);
  record::ByName<record::TrafficSeen> all;
  for (const auto& way : ways_of(traffic)) {
    const bool there = way == to_component;
    const auto received = rate_of(by_host, there ? "component" : "controller", way);
    const bool still_there = running(by_host, way);
    all[way] = {.asked_bit_s = traffic.bits_per_s,
                .sent_bit_s = rate_of(by_host, there ? "controller" : "component", way),
                .received_bit_s = received,
                .running = still_there,
                .is_short = !still_there || !received || *received < enough};
  }
  return all;
}

std::vector<std::string> shortfalls(const record::ByName<record::TrafficSeen>& achieved) {
  std::vector<std::string> texts;
  for (const auto& [way, rates] : achieved)
    if (rates.is_short == true)
      texts.push_back(fmt::format(
          "TRAFFIC SHORTFALL: {} of {} Mbit/s arrived at the {} ({} sent{})", megabits(rates.received_bit_s),
          megabits(rates.asked_bit_s), way == to_component ? "component" : "controller",
          megabits(rates.sent_bit_s), rates.running ? "" : "; iperf3 died before the end"));
  return texts;
}

}  // namespace ontime::campaign

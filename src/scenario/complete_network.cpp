// SPDX-License-Identifier: Apache-2.0
// Checks of traffic, link faults and background topics.
#include <sstream>
#include <string_view>

#include <fmt/format.h>

#include "scenario/complete.hpp"

namespace ontime::scenario {
namespace {

using conditions::has_etf, conditions::text_of, conditions::Traffic;

// tc accepts abbreviations of the word.
bool has_deadline_mode(const std::string& qdisc) {
  std::istringstream words(qdisc);
  for (std::string word; words >> word;)
    if (word.size() >= 2 && std::string_view("deadline_mode").starts_with(word)) return true;
  return false;
}

// Without an etf a launch time has no effect; without a launch time, an etf drops all.
void complete_launch(const Run& run) {
  const auto& qdisc = run.faults.qdisc;
  const bool asked = run.task.config.launch_ns > 0;
  if (asked != has_etf(qdisc))
    throw std::invalid_argument(
        asked ? "launch-time needs an etf. Example: link.qdisc: prio bands 2 priomap 1 1 1 1 1 1 0 1 1 1 1 1 "
                "1 1 1 1 below 1 etf clockid CLOCK_TAI delta 300000, with link.message-priority: 6"
              : "the etf of link.qdisc drops packets without a launch time: add launch-time");
  if (!asked) return;
  if (qdisc.starts_with("etf") && !is_below_ip(run.task.transport))
    refuse(
        "an etf at the root also drops ARP, which IP needs. Example: link.qdisc: prio bands 2 priomap 1 1 1 "
        "1 1 1 0 1 1 1 1 1 1 1 1 1 below 1 etf …, with link.message-priority: 6");
  if (has_deadline_mode(qdisc))
    refuse(
        "with deadline_mode an etf sends a message before its launch-time: leave out deadline_mode or "
        "launch-time");
  if (run.task.client.schedule == roundtrip::Schedule::back_to_back)
    refuse(
        "launch-time counts from a due time, which schedule back-to-back does not have: use another "
        "schedule");
  if (2 * run.task.config.launch_ns >= run.task.client.timeout.count())
    refuse(
        "message and answer each wait for launch-time, in total for timeout or longer: every message would "
        "be lost");
  if (run.faults.duplicates > 0)
    refuse(
        "the etf drops the copies by link.duplicate, which have no launch-time: leave out link.duplicate or "
        "launch-time");
  const bool is_beside =
      run.faults.traffic_priority && run.faults.traffic_priority != run.faults.message_priority;
  if (run.traffic.bits_per_s > 0 && (qdisc.starts_with("etf") || !is_beside))
    refuse(
        "an etf drops packets without a launch-time: give the traffic a class beside the etf, by "
        "link.traffic-priority");
  if (run.explain)
    refuse(
        "explain cannot tell a wait for launch-time from a wait in a queue: leave out explain or "
        "launch-time");
}

void complete_link(const Run& run) {
  const auto& faults = run.faults;
  if (faults.delay.count() == 0 && (faults.jitter.count() > 0 || faults.reordered > 0))
    refuse("link.jitter and link.reorder need a link.delay");
  if (!faults.qdisc.empty() && faults.delay.count() > 0)
    refuse("link.qdisc and link.delay both set the queueing discipline of the interface: leave out one");
  if (faults.traffic_priority && run.traffic.bits_per_s == 0)
    refuse("link.traffic-priority needs a traffic.rate");
  if (faults.jitter > faults.delay) refuse("link.jitter must not be more than link.delay");
  complete_launch(run);
  if (run.cut && run.cut->at >= run.task.client.duration)
    refuse("link.cut must begin before the end of duration");
}

constexpr std::chrono::microseconds least_step{10};  // between two messages of one sending thread
constexpr std::uint64_t most_kept_bytes = std::uint64_t{1} << 30;  // of all their topics, at each end
constexpr std::uint64_t depth = 10;  // of each topic, as roundtrip/background.cpp has it

// These places exist only in a transport with nodes and executors.
void check_place(const Run& run) {
  const auto* const where = roundtrip::word_of(run.task.background.where);
  for (const auto& transport : {run.task.transport, run.component_transport})
    if (const auto can = transport::declared(transport); can && !can->nodes)
      refuse(
          "background.where: {} needs ROS 2, and {} has no nodes or executors: use "
          "same-participant, same-process or other-process",
          where, transport);
  if (run.task.config.receive == transport::Receive::waitset)
    refuse(
        "background.where: {} needs an executor, which receive: waitset does not have: use receive: listener",
        where);
}

}  // namespace

std::string without_port(const std::string& address) {
  const auto colon = address.find(':');
  return colon == address.rfind(':') ? address.substr(0, colon) : address;
}

void complete_network(Run& run) {
  if (run.traffic.bits_per_s == 0 && run.traffic != Traffic{})
    refuse("traffic has settings but no rate: set traffic.rate");
  complete_link(run);
  // A transport that is not known here uses it if it needs it.
  if (const auto can = transport::declared(run.task.transport); !can || can->below_ip)
    run.task.config.priority = run.faults.message_priority;
}

void complete_background(const Run& run) {
  const auto& background = run.task.background;
  if (background.topics == 0) {
    if (run.describes_background)
      refuse("background topics have settings but no number: set background.topics");
    return;
  }
  for (const auto& transport : {run.task.transport, run.component_transport}) {
    const auto can = transport::declared(transport);
    if (!can || can->background) continue;
    if (can->topics) refuse("transport {} has no background topics: use a DDS transport", transport);
    refuse("transport {} has no topics, so no background topics: use traffic for other packets on the link",
           transport);
  }
  if (transport::is_of_nodes(background.where)) check_place(run);
  if (background.period / background.topics < least_step)
    refuse(
        "background.rate: {} topics with a message every {} are more than 100000 messages/s in "
        "each direction",
        background.topics, text_of(background.period));
  if (static_cast<std::uint64_t>(background.topics) * depth * background.payload_bytes > most_kept_bytes)
    refuse(
        "background.payload: {} topics, each with {} kept messages of {} bytes, need more than 1 "
        "GiB of memory at each end",
        background.topics, depth, background.payload_bytes);
  if (run.component_restart)
    refuse(
        "lost background messages cannot be counted across a restart: leave out background or "
        "component.restart");
  auto config = run.task.config;
  for (auto* topic : {&config.ping_topic, &config.pong_topic})
    *topic = roundtrip::background_topic(*topic, background.topics);
  check_topics(config);
}

}  // namespace ontime::scenario

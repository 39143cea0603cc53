// SPDX-License-Identifier: Apache-2.0
// What can be said of ordinary topics beside the critical one.
#include <cstdint>

#include <fmt/ranges.h>

#include "campaign/keys.hpp"

namespace ontime::campaign {
namespace {

using Text = const std::string&;
using roundtrip::NeighbourOptions;

constexpr int most_topics = 100;
constexpr std::chrono::microseconds least_step{10};  // between two messages of one sending thread
constexpr const char* places =
    "same-participant, same-process, other-process; of ros2 also same-callback-group, same-node, "
    "same-executor, own-executor";

bool is_of_ros2(roundtrip::Where where) { return where < roundtrip::Where::same_participant; }

constexpr std::uint64_t most_kept_bytes = std::uint64_t{1} << 30;  // of all their topics, at each end
constexpr std::uint64_t depth = 10;  // of each topic, as roundtrip/neighbours.cpp has it

NeighbourOptions& described(Run& run) {
  run.describes_neighbours = true;
  return run.task.neighbours;
}

// What only a transport with nodes and executors has.
void check_place(const Run& run) {
  const auto* const where = roundtrip::word_of(run.task.neighbours.where);
  for (const auto& transport : {run.task.transport, run.component_transport})
    if (!transport.empty() && transport != "ros2")
      throw std::invalid_argument(fmt::format(
          "neighbours.where: {} is ROS 2's, and {} has no nodes, callback groups or executors; it "
          "has same-participant, same-process and other-process",
          where, transport));
  if (run.task.config.receive == transport::Receive::waitset)
    throw std::invalid_argument(
        fmt::format("neighbours.where: {} is in or beside an executor, and with receive waitset there is "
                    "none; it needs receive listener",
                    where));
}

}  // namespace

std::vector<Key> neighbour_keys() {
  const auto client = Key::For::client;
  return {
      {"neighbours.topics", "", "1-100", "ordinary topics beside the critical one: none", client,
       [](Run& run, Text text) {
         run.task.neighbours.topics = static_cast<int>(number_of(text, 1, most_topics));
       }},
      {"neighbours.where", "",
       "same-callback-group|same-node|same-executor|own-executor|same-participant|same-process|other-process",
       "the most that they share with the critical topic, the first four with ros2 alone: same-participant",
       client,
       [](Run& run, Text text) { described(run).where = one_of(roundtrip::where_of(text), text, places); }},
      {"neighbours.rate", "", "RATE", "of messages, of each topic and direction: 100 Hz", client,
       [](Run& run, Text text) { described(run).period = period_of_rate(text); }},
      {"neighbours.payload", "", "SIZE", "of each message: 1 kB", client,
       [](Run& run, Text text) { described(run).payload_bytes = payload_of(text); }},
      {"neighbours.reliability", "", "best-effort|reliable",
       "of their topics, which keep the last 10: best-effort", client,
       [](Run& run, Text text) {
         described(run).reliability = one_of(agent::reliability_of(text), text, "best-effort, reliable");
       }},
      {"neighbours.direction", "", "both|to-component|to-controller", "of their messages: both", client,
       [](Run& run, Text text) {
         const auto direction = one_of(direction_of(text), text, "both, to-component, to-controller");
         described(run).there = direction != Traffic::Direction::to_controller;
         described(run).back = direction != Traffic::Direction::to_component;
       }},
      {"neighbours.priority", "", "1-99", "SCHED_FIFO priority of the threads that are theirs alone: none",
       client,
       [](Run& run, Text text) { described(run).priority = static_cast<int>(number_of(text, 1, 99)); }},
      {"neighbours.callback", "", "TIME", "of a CPU, that each message's callback takes: none", client,
       [](Run& run, Text text) {
         described(run).callback = positive_duration(text, std::chrono::hours(1));
       }}};
}

void complete_neighbours(const Run& run) {
  const auto& neighbours = run.task.neighbours;
  if (neighbours.topics == 0) {
    if (run.describes_neighbours)
      throw std::invalid_argument(
          "neighbours are described, but there are none: neighbours.topics says how many");
    return;
  }
  for (const auto& transport : {run.task.transport, run.component_transport}) {
    if (transport == "udp")
      throw std::invalid_argument(
          "transport udp has no topics, and so no neighbours: what goes over the link beside its messages is "
          "`traffic`");
    if (is_below_ip(transport))
      throw std::invalid_argument(fmt::format("transport {} has no neighbours; DDS has", transport));
  }
  if (is_of_ros2(neighbours.where)) check_place(run);
  if (neighbours.period / neighbours.topics < least_step)
    throw std::invalid_argument(fmt::format(
        "neighbours.rate: {} of them with a message every {} are more than 100000 messages a second, "
        "each way",
        neighbours.topics, text_of(neighbours.period)));
  if (static_cast<std::uint64_t>(neighbours.topics) * depth * neighbours.payload_bytes > most_kept_bytes)
    throw std::invalid_argument(fmt::format(
        "neighbours.payload: {} of them keep the last {} messages of {} bytes, which is more than 1 GiB "
        "of memory at each end",
        neighbours.topics, depth, neighbours.payload_bytes));
  if (run.component_restart)
    throw std::invalid_argument(
        "neighbours of an end that is started again have nobody to count what they lost: leave out "
        "neighbours, or component.restart");
  auto config = run.task.config;
  for (auto* topic : {&config.ping_topic, &config.pong_topic})
    *topic = roundtrip::neighbour_topic(*topic, neighbours.topics);
  check_topics(config);
}

}  // namespace ontime::campaign

// SPDX-License-Identifier: Apache-2.0
#include "keeper/keeper.hpp"

namespace ontime::keeper {

using nlohmann::json;

namespace {

json or_null(const std::optional<int>& number) { return number ? json(*number) : json(); }
std::optional<int> number_of(const json& from) {
  return from.is_null() ? std::nullopt : std::optional(from.get<int>());
}

}  // namespace

json to_json(const background::Workers& workers) {
  return {{"cpu", workers.cpu},
          {"vm", workers.vm},
          {"io", workers.io},
          {"hdd", workers.hdd},
          {"vm_bytes", workers.vm_bytes},
          {"hdd_bytes", workers.hdd_bytes}};
}

background::Workers workers_of(const json& from) {
  return {from.at("cpu"), from.at("vm"),       from.at("io"),
          from.at("hdd"), from.at("vm_bytes"), from.at("hdd_bytes")};
}

json to_json(const isolation::Wish& wish) {
  return {{"cpus", wish.cpus},
          {"interrupts", wish.interrupts},
          {"load_quota", wish.load_quota},
          {"load_weight", wish.load_weight}};
}

isolation::Wish wish_of(const json& from) {
  return {.cpus = from.at("cpus"),
          .interrupts = from.at("interrupts"),
          .load_quota = from.at("load_quota"),
          .load_weight = from.at("load_weight")};
}

json to_json(const background::Faults& faults) {
  return {{"loss", faults.loss},
          {"duplicates", faults.duplicates},
          {"delay_us", faults.delay.count()},
          {"jitter_us", faults.jitter.count()},
          {"reordered", faults.reordered},
          {"cut", faults.cut},
          {"qdisc", faults.qdisc},
          {"message_priority", or_null(faults.message_priority)},
          {"traffic_priority", or_null(faults.traffic_priority)}};
}

background::Faults faults_of(const json& from) {
  return {.loss = from.at("loss"),
          .duplicates = from.at("duplicates"),
          .delay = std::chrono::microseconds(from.at("delay_us")),
          .jitter = std::chrono::microseconds(from.at("jitter_us")),
          .reordered = from.at("reordered"),
          .cut = from.at("cut"),
          .qdisc = from.at("qdisc"),
          .message_priority = number_of(from.at("message_priority")),
          .traffic_priority = number_of(from.at("traffic_priority"))};
}

json to_json(const background::Stream& stream) {
  return {{"place", stream.place},         {"serves", stream.serves},
          {"receives", stream.receives},   {"address", stream.address},
          {"interface", stream.interface}, {"port", stream.port},
          {"bit_s", stream.bits_per_s},    {"datagram_bytes", stream.datagram_bytes},
          {"priority", stream.priority}};
}

background::Stream stream_of(const json& from) {
  return {.place = from.at("place"),
          .serves = from.at("serves"),
          .receives = from.at("receives"),
          .address = from.at("address"),
          .interface = from.at("interface"),
          .port = from.at("port"),
          .bits_per_s = from.at("bit_s"),
          .datagram_bytes = from.at("datagram_bytes"),
          .priority = from.at("priority"),
          .groups = {}};
}

}  // namespace ontime::keeper

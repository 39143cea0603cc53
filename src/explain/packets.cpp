// SPDX-License-Identifier: Apache-2.0
#include "explain/packets.hpp"

#include <map>
#include <set>

namespace ontime::explain {

using trace::Kind;

namespace {

// An interface hands a packet on while it sends it, on the same CPU and in the same thread. That need not be
// the thread that gave it to the kernel: a queue may release it later.
bool is_handed_on(const Packet& packet, const trace::Event& event) {
  return packet.sent != nullptr && packet.received == nullptr && packet.sent->cpu == event.cpu &&
         packet.sent->thread.id == event.thread.id && packet.queues.back().in->what != event.what &&
         packet.queued->bytes == event.bytes;
}

}  // namespace

std::vector<Packet> packets_of(const Timeline& timeline, const std::function<bool(std::int32_t)>& is_sender,
                               bool one_machine, std::int64_t from_ns, std::int64_t to_ns) {
  std::vector<Packet> packets;
  std::map<std::int32_t, std::size_t> open;  // by number, those that are not done with
  std::set<std::int32_t> foreign;            // numbers of those that came from elsewhere
  for (const auto& event : timeline.events()) {
    if (event.at_ns < from_ns || event.at_ns > to_ns) continue;
    if (event.kind == Kind::queued) {
      if (const auto on = open.find(event.packet); on != open.end()) {
        auto& packet = packets[on->second];
        if (is_handed_on(packet, event)) {
          packet.sent = nullptr;
          packet.queues.push_back({.in = &event});
          continue;
        }
      }
      open.erase(event.packet);
      foreign.erase(event.packet);
      if (!is_sender(event.thread.id)) continue;
      if (event.packet != 0) open[event.packet] = packets.size();
      packets.push_back({.queued = &event, .queues = {{.in = &event}}});
      continue;
    }
    const auto found = open.find(event.packet);
    if (found == open.end()) {
      if (event.kind == Kind::received && event.packet != 0) foreign.insert(event.packet);
      // A softirq that interrupts the sender works on packets of others.
      if (event.kind == Kind::dropped && is_sender(event.thread.id) && !foreign.contains(event.packet) &&
          timeline.interrupts(event.cpu, event.at_ns, event.at_ns + 1).empty())
        packets.push_back({.dropped = &event});
      continue;
    }
    auto& packet = packets[found->second];
    if (event.kind == Kind::sent && packet.sent == nullptr) packet.sent = packet.queues.back().out = &event;
    if (event.kind == Kind::received && packet.received == nullptr && packet.sent != nullptr && one_machine)
      packet.received = &event;
    if (event.kind == Kind::dropped) {
      packet.dropped = &event;
      open.erase(found);
    }
  }
  return packets;
}

}  // namespace ontime::explain

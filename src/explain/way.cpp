// SPDX-License-Identifier: Apache-2.0
#include "explain/way.hpp"

#include <algorithm>
#include <limits>

#include "explain/threads.hpp"

namespace ontime::explain {
namespace {

using trace::Event;
using trace::Kind;

// The minimum size of the first packet of a fragmented message: every IPv4 link carries 576 bytes.
constexpr std::int64_t fragment_bytes = 500;
constexpr std::int64_t header_bytes = 34;  // of each packet, at least: Ethernet's and IPv4's

bool has_run(const Timeline& timeline, std::int32_t thread, std::int64_t from_ns, std::int64_t to_ns) {
  return std::ranges::any_of(timeline.of(thread, from_ns, to_ns), has_cpu, &Stretch::state);
}

// When that thread queues its next packet.
std::int64_t next_sent_ns(const Timeline& timeline, std::int32_t thread, std::int64_t from_ns) {
  for (const auto& event : timeline.events())
    if (event.kind == Kind::queued && event.thread.id == thread && event.at_ns >= from_ns) return event.at_ns;
  return std::numeric_limits<std::int64_t>::max();
}

// When the running thread got its CPU.
std::int64_t running_since_ns(const Timeline& timeline, std::int32_t thread, std::int64_t at_ns) {
  const auto stretches = timeline.of(thread, timeline.events().front().at_ns, at_ns);
  const auto before = std::find_if(stretches.rbegin(), stretches.rend(),
                                   [](const Stretch& stretch) { return !has_cpu(stretch.state); });
  return before == stretches.rend() ? timeline.events().front().at_ns : before->to_ns;
}

}  // namespace

std::int64_t least_packet_bytes(std::int64_t payload_bytes) {
  return std::min(payload_bytes, fragment_bytes);
}

bool End::has(std::int32_t thread) const {
  return std::ranges::find(threads, thread, &KnownThread::id) != threads.end();
}

// Whether packets keep their number from one end's interface to the other's, as over loopback and between two
// network namespaces; over a wire they do not.
bool hands_packets_over(const End& one, const End& other) {
  if (one.timeline == nullptr || one.timeline->events().empty()) return false;
  const auto any_thread = [](std::int32_t) { return true; };
  const auto is_of = [](const std::string& interface, const Event& event) {
    return interface.empty() ? event.what != "lo" : event.what == interface;
  };
  const auto& events = one.timeline->events();
  const auto packets = packets_of(*one.timeline, any_thread, true, events.front().at_ns, events.back().at_ns);
  return std::any_of(packets.begin(), packets.end(), [&](const Packet& packet) {
    const auto goes = [&](const End& from, const End& to) {
      return is_of(from.interface, *packet.queues.back().in) && is_of(to.interface, *packet.received) &&
             (packet.received->what == "lo" || packet.queues.back().in->what != packet.received->what);
    };
    return packet.received != nullptr && !packet.queues.empty() && (goes(one, other) || goes(other, one));
  });
}

Way::Way(End client, End server, const Usual& usual, std::int64_t payload_bytes, bool one_machine)
    : client_(std::move(client)),
      server_(std::move(server)),
      usual_(usual),
      payload_bytes_(payload_bytes),
      packet_bytes_(least_packet_bytes(payload_bytes)),
      one_machine_(one_machine),
      is_handed_over_(one_machine && hands_packets_over(client_, server_)) {}

void Way::thread(Delay& found, const End& end, std::int32_t id, const std::string& role, Stage stage,
                 std::int64_t from_ns, std::int64_t to_ns) {
  if (end.timeline == nullptr) return;
  // These stages begin with a time that the thread itself noted.
  const bool has_cpu = stage == Stage::sent || stage == Stage::answered ||
                       (stage == Stage::left && (role == "send" || role == "receive" || role == "delivery"));
  follow(found, *end.timeline, {.stage = stage, .end = end.name, .thread = role, .thread_id = id}, from_ns,
         to_ns, has_cpu);
}

const KnownThread* Way::with(const End& end, const std::string& role) {
  const auto found = std::ranges::find(end.threads, role, &KnownThread::role);
  return found == end.threads.end() ? nullptr : &*found;
}

// A middleware may have several receive threads. Returns the one that ran when the message arrived, else one
// that should have run.
const KnownThread* Way::receives(const End& end, std::int64_t at_ns) const {
  if (end.timeline == nullptr) return nullptr;
  const KnownThread* best = nullptr;
  std::vector<const KnownThread*> running;
  for (const auto& thread : end.threads) {
    if (thread.role != "receive" && thread.role != "delivery") continue;
    const auto state = end.timeline->state_at(thread.id, at_ns);
    if (state && has_cpu(*state)) running.push_back(&thread);
    if (best == nullptr || (state && *state != State::sleeps)) best = &thread;
  }
  if (running.empty()) return best;
  // A multi-threaded executor runs several: the thread that sends first is the one that answers. A thread
  // that takes an answer sends nothing. Then it is the one that began last: the others had other work.
  const auto rank = [&](const KnownThread* one) {
    return std::pair(next_sent_ns(*end.timeline, one->id, at_ns),
                     -running_since_ns(*end.timeline, one->id, at_ns));
  };
  return *std::ranges::min_element(running, {}, rank);
}

// The delay from the packet's arrival on: through the threads that hand it on, the last one first.
void Way::receiver(Delay& found, const End& end, std::int64_t from_ns, std::int64_t to_ns) const {
  const auto* last = receives(end, to_ns);
  if (last == nullptr) return;
  auto id = last->id;
  auto role = last->role;
  for (int hands = 0; hands < 4; ++hands) {
    const Event* woken = nullptr;
    for (const auto& event : end.timeline->events())
      if (event.kind == Kind::waking && event.thread.id == id && event.at_ns > from_ns + at_once_ns &&
          event.at_ns < to_ns)
        woken = &event;
    // A thread that had already begun with the message waits for a lock, or for the work of another thread.
    const bool had_begun = woken != nullptr && has_run(*end.timeline, id, from_ns, woken->at_ns);
    const bool by_another = woken != nullptr && !had_begun && woken->other.id != id &&
                            end.has(woken->other.id) &&
                            end.timeline->state_at(woken->other.id, woken->at_ns) == State::runs;
    thread(found, end, id, role, Stage::delivered, by_another ? woken->at_ns : from_ns, to_ns);
    if (!by_another) return;
    to_ns = woken->at_ns;
    id = woken->other.id;
    role = std::ranges::find(end.threads, id, &KnownThread::id)->role;
  }
}

// The last of a message's packets, which completes it; or a dropped one.
Packet Way::last_packet(const End& from, std::int64_t from_ns, std::int64_t to_ns) const {
  const auto is_of_end = [&](std::int32_t thread) { return from.has(thread); };
  Packet last;
  std::int64_t carried = 0;
  for (const auto& one : packets_of(*from.timeline, is_of_end, is_handed_over_, from_ns, to_ns)) {
    if (one.queued == nullptr) {
      if (carried > 0 || one.dropped->at_ns < from_ns + before_queue_ns) return one;
      continue;
    }
    const bool is_of_it =
        carried == 0 ? one.queued->bytes >= packet_bytes_ : one.queued->thread.id == last.queued->thread.id;
    if (!is_of_it) continue;
    last = one;
    carried += one.queued->bytes - header_bytes;
    if (last.dropped != nullptr || last.queued->bytes >= payload_bytes_ || carried >= payload_bytes_) break;
  }
  return last;
}

// GRO may join several packets into one: then the first is received, with the bytes of all, and the others
// are freed with it, which is not a drop.
constexpr std::string_view freed_with_another = "skb_release";
void find_joined(Packet& packet, const End& to, std::int64_t to_ns) {
  const bool is_freed = packet.dropped != nullptr && packet.dropped->what.starts_with(freed_with_another);
  if (packet.received != nullptr || (packet.dropped != nullptr && !is_freed)) return;
  const auto until_ns = is_freed ? packet.dropped->at_ns : to_ns;
  const auto& events = to.timeline->events();
  const auto found = std::find_if(events.begin(), events.end(), [&](const Event& event) {
    return event.kind == Kind::received && event.what == to.interface && event.at_ns > packet.sent->at_ns &&
           event.at_ns <= until_ns && event.bytes > packet.queued->bytes;
  });
  if (found == events.end()) return;
  packet.received = &*found;
  packet.dropped = nullptr;
}

Packet Way::packet(const End& from, const End& to, std::int64_t from_ns, std::int64_t to_ns) const {
  if (from.timeline == nullptr) return {};
  auto packet = last_packet(from, from_ns, to_ns);
  if (packet.sent == nullptr || to.timeline == nullptr) return packet;
  if (is_handed_over_) {
    find_joined(packet, to, to_ns);
    return packet;
  }
  // Over a wire it is the last packet of that size that arrived.
  for (const auto& event : to.timeline->events())
    if (may_have_come(packet, to, event, to_ns)) packet.received = &event;
  return packet;
}

// Over a wire, by two clocks, where it may have another number.
bool Way::may_have_come(const Packet& packet, const End& to, const Event& event, std::int64_t to_ns) const {
  return event.kind == Kind::received && event.bytes >= packet_bytes_ &&
         (!one_machine_ || event.what == to.interface) && event.at_ns <= to_ns &&
         event.at_ns >= packet.sent->at_ns - usual_.uncertainty_ns(packet.sent->at_ns);
}

// What the kernel did next with the packet that has this number, if that was to drop it.
const Event* dropped_next(const Timeline& timeline, const Event& received, std::int64_t to_ns) {
  const auto& events = timeline.events();
  const auto next = std::find_if(events.begin(), events.end(), [&](const Event& event) {
    return event.packet == received.packet && event.at_ns > received.at_ns;
  });
  const bool is_drop = next != events.end() && next->kind == Kind::dropped && next->at_ns <= to_ns &&
                       !next->what.starts_with(freed_with_another);
  return is_drop ? &*next : nullptr;
}

// Over a wire it is the first packet that came, if it was dropped there: later messages arrive later.
Packet Way::lost_packet(const End& from, const End& to, std::int64_t from_ns, std::int64_t to_ns) const {
  auto packet = this->packet(from, to, from_ns, to_ns);
  if (is_handed_over_ || packet.received == nullptr) return packet;
  const auto& events = to.timeline->events();
  const auto first = std::find_if(events.begin(), events.end(), [&](const Event& event) {
    return may_have_come(packet, to, event, to_ns) && event.bytes <= packet.queued->bytes;
  });
  if (first == events.end()) return packet;
  if (const auto* dropped = dropped_next(*to.timeline, *first, to_ns)) {
    packet.received = &*first;
    packet.dropped = dropped;
  }
  return packet;
}

void Way::held_in_queue(Delay& found, const End& from, const Packet& packet, std::int64_t until_ns) const {
  for (const auto& [in, out] : packet.queues) {
    const auto out_ns = out != nullptr ? out->at_ns : until_ns;
    if (out_ns - in->at_ns <= at_once_ns) continue;
    found.add({.cause = Cause::queue, .stage = Stage::queued, .end = from.name, .culprit = in->what},
              {in->at_ns, out_ns, State::unknown, -1});
  }
}

// The delay in the kernel threads that receive the packet, the last one first: an interrupt thread may wake a
// NAPI thread. The thread that ran at that wake-up was only interrupted.
void Way::brought(Delay& found, const End& to, std::int32_t id, std::int64_t from_ns,
                  std::int64_t to_ns) const {
  const auto& timeline = *to.timeline;
  for (auto name = timeline.name_of(id); is_kernels(name); name = timeline.name_of(id)) {
    const Event* woken = nullptr;
    for (const auto& event : timeline.events())
      if (event.kind == Kind::waking && event.thread.id == id && event.at_ns > from_ns && event.at_ns < to_ns)
        woken = &event;
    const bool by_another =
        !is_interrupts(name) && woken != nullptr && is_interrupts(timeline.name_of(woken->other.id));
    thread(found, to, id, name, Stage::travelled, by_another ? woken->at_ns : from_ns, to_ns);
    if (!by_another) return;
    to_ns = woken->at_ns;
    id = woken->other.id;
  }
}

// The kernel's work on a packet from its arrival until it wakes the reader: mostly packet filter rules.
void Way::taken_in(Delay& found, const End& to, const Event& received, std::int64_t to_ns) const {
  const auto& timeline = *to.timeline;
  const auto softirq = timeline.interrupts(received.cpu, received.at_ns, to_ns);
  const bool in_softirq = !softirq.empty() && softirq.front().from_ns == received.at_ns;
  const auto name = in_softirq ? softirq.front().what : timeline.name_of(received.thread.id);
  if (!in_softirq && !is_kernels(name)) return;
  const auto& events = timeline.events();
  const auto woken = std::find_if(events.begin(), events.end(), [&](const Event& event) {
    return event.kind == Kind::waking && event.cpu == received.cpu && event.at_ns >= received.at_ns &&
           to.has(event.thread.id);
  });
  if (woken == events.end() || woken->at_ns > to_ns) return;
  if (in_softirq && woken->at_ns > softirq.front().to_ns) {  // a thread preempted it
    const auto id = received.thread.id;
    if (is_kernels(timeline.name_of(id)))
      thread(found, to, id, timeline.name_of(id), Stage::travelled, softirq.front().to_ns, woken->at_ns);
    return;
  }
  add(found.ran, {.stage = Stage::travelled, .end = to.name, .thread = name, .thread_id = received.thread.id},
      {received.at_ns, woken->at_ns, State::runs, received.cpu});
}

// When a middleware sent a dropped packet again: the last time before `to_ns` that another thread of that end
// queued as much. The thread that sent it first goes on with the next messages. nullptr: not seen.
const Event* sent_again(const End& from, const Packet& packet, std::int64_t to_ns) {
  if (packet.queued == nullptr || packet.dropped == nullptr ||
      packet.dropped->what.starts_with(freed_with_another))
    return nullptr;
  const Event* again = nullptr;
  for (const auto& event : from.timeline->events())
    if (event.kind == Kind::queued && event.at_ns > packet.dropped->at_ns && event.at_ns <= to_ns &&
        event.bytes >= packet.queued->bytes && event.thread.id != packet.queued->thread.id &&
        from.has(event.thread.id))
      again = &event;
  return again;
}

Part Way::drop_of(const Packet& packet, const End& from, const End& to) const {
  const bool here = packet.sent == nullptr || (packet.received == nullptr && !one_machine_);
  return {.cause = Cause::dropped,
          .stage = packet.received != nullptr ? Stage::delivered
                   : packet.sent == nullptr   ? Stage::queued
                                              : Stage::travelled,
          .end = here ? from.name : to.name,
          .culprit = packet.dropped->what};
}

// From when the sender's thread has the message until the packet is received, as far as it came.
void Way::passage(Delay& found, const End& from, const End& to, const Packet& way,
                  std::int64_t from_ns) const {
  const auto known = std::ranges::find(from.threads, way.queued->thread.id, &KnownThread::id);
  thread(found, from, known->id, known->role, Stage::left, from_ns, way.queued->at_ns);
  if (way.sent == nullptr) return;
  held_in_queue(found, from, way, way.sent->at_ns);
  if (way.received != nullptr)
    brought(found, to, way.received->thread.id, way.sent->at_ns, way.received->at_ns);
}

void Way::leg(Delay& found, const End& from, const End& to, std::int64_t from_ns, std::int64_t to_ns) const {
  const auto way = packet(from, to, from_ns, to_ns);
  // Some drivers free every packet that they have sent as if they dropped it.
  const bool may_be_freed = way.sent != nullptr && !is_handed_over_;
  const auto* const again = may_be_freed ? nullptr : sent_again(from, way, to_ns);
  if (way.queued == nullptr || (way.dropped != nullptr && again == nullptr)) {
    receiver(found, to, from_ns, to_ns);
    // The unknown part belongs to where the packet was last seen: another process or the kernel may have held
    // it.
    if (from.timeline != nullptr) found.last = {.stage = Stage::left, .end = from.name};
    return;
  }
  passage(found, from, to, way, from_ns);
  if (again != nullptr) {
    found.add(drop_of(way, from, to), {way.dropped->at_ns, again->at_ns, State::unknown, -1});
    return leg(found, from, to, again->at_ns, to_ns);
  }
  if (way.received != nullptr) taken_in(found, to, *way.received, to_ns);
  const auto* const last = way.received != nullptr ? way.received
                           : way.sent != nullptr   ? way.sent
                                                   : way.queued;
  receiver(found, to, last->at_ns, to_ns);
}

// Whether the kernel asked for the neighbour's address (ARP).
bool is_sought_by(const End& from, const Leg& times) {
  if (from.timeline == nullptr) return false;
  return std::ranges::any_of(from.timeline->events(), [&](const Event& event) {
    return event.kind == Kind::no_neighbour && from.has(event.thread.id) && times.from_ns <= event.at_ns &&
           event.at_ns <= times.to_ns;
  });
}

// Takes that time off the queues: where a link delays every message, its queue makes none late.
void leave_out_of_queues(Delay& found, std::int64_t usual_ns) {
  for (auto& part : found.parts) {
    if (part.cause != Cause::queue) continue;
    const auto ns = std::clamp<std::int64_t>(usual_ns, 0, part.ns);
    part.ns -= ns;
    usual_ns -= ns;
    found.held_ns -= ns;
  }
  std::erase_if(found.parts, [](const Part& part) { return part.ns == 0; });
}

// The part above the usual duration that no state of a thread or packet explains: the largest first.
void Way::rest(Delay& found, std::size_t leg, const Leg& times) const {
  if (usual_.is_of_on_time())
    leave_out_of_queues(found, usual_.leg_ns(leg) + found.held_ns - times.length_ns());
  auto left_ns = times.length_ns() - found.held_ns - usual_.leg_ns(leg);
  const auto take = [&](Part part, Cause cause, std::int64_t most_ns, const std::vector<Stretch>& when) {
    const auto ns = std::min(left_ns, most_ns);
    part.cause = cause;
    found.add(std::move(part), ns, when);
    left_ns -= std::max<std::int64_t>(ns, 0);
  };
  const auto take_all = [&](Cause cause, std::vector<Spent>& all) {
    std::ranges::stable_sort(all, std::ranges::greater(), &Spent::ns);
    for (const auto& [whose, ns, when] : all) take(whose, cause, ns, when);
  };
  constexpr std::size_t waking = 0, sending = 1, there = 2, answering = 3, back = 4;
  if (leg == waking) take_all(Cause::timer, found.slept);
  take_all(Cause::busy, found.ran);
  if (leg == sending || leg == answering) take_all(Cause::waited, found.slept);
  if (leg == there || leg == back) {
    const bool is_sought = is_sought_by(leg == there ? client_ : server_, times);
    if (const auto down =
            link_down(Stage::travelled, times.from_ns, times.to_ns, is_sought ? forgotten_ns : 0))
      take(*down, down->cause, down->ns, down->when);
  }
  take(found.last, Cause::unknown, left_ns, {});
}

std::vector<Part> Way::delays_of(const roundtrip::Sample& sample) {
  std::vector<Part> all;
  const auto way = usual_.of(sample);
  const bool has_times = has_server_times(sample);
  for (std::size_t number = 0; number < (has_times ? legs : senders_legs); ++number) {
    const auto [from_ns, to_ns] = way[number];
    Delay found;
    constexpr Stage stages[] = {Stage::woke, Stage::sent, Stage::delivered, Stage::answered,
                                Stage::delivered};
    found.last = {.stage = stages[number], .end = number == 2 || number == 3 ? server_.name : client_.name};
    if (number < 2) {
      if (const auto* sends = with(client_, "send"))
        thread(found, client_, sends->id, "send", stages[number], from_ns, to_ns);
    } else if (number == 3) {
      if (const auto* answers = receives(server_, from_ns))
        thread(found, server_, answers->id, answers->role, Stage::answered, from_ns, to_ns);
    } else {
      leg(found, number == 2 ? client_ : server_, number == 2 ? server_ : client_, from_ns, to_ns);
    }
    rest(found, number, way[number]);
    all.insert(all.end(), found.parts.begin(), found.parts.end());
  }
  if (!has_times) {
    Delay both_legs;
    both_legs.add({.cause = Cause::unknown, .stage = Stage::delivered, .end = client_.name},
                  sample.received_ns - sample.sent_ns - usual_.round_trip_ns(), {});
    all.insert(all.end(), both_legs.parts.begin(), both_legs.parts.end());
  }
  std::ranges::stable_sort(all, std::ranges::greater(), &Part::ns);
  return all;
}

}  // namespace ontime::explain

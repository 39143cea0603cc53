// SPDX-License-Identifier: Apache-2.0
// Where lost messages ended, and links that were down.
#include <algorithm>
#include <map>
#include <string>

#include "explain/way.hpp"

namespace ontime::explain {
namespace {

using trace::Event;
using trace::Kind;

// The maximum delay of the kernel's report that a link was taken down, or lost its carrier (reported once a
// second).
constexpr std::int64_t reported_within_ns = 20'000'000, carrier_reported_within_ns = 1'000'000'000;
const std::string no_neighbour = "no neighbour";

// When the thread first had a CPU. Its work waits until then.
std::int64_t ran_from_ns(const Timeline& timeline, std::int32_t thread, std::int64_t from_ns,
                         std::int64_t to_ns) {
  for (const auto& stretch : timeline.of(thread, from_ns, to_ns))
    if (has_cpu(stretch.state)) return stretch.from_ns;
  return from_ns;
}

}  // namespace

// The interface that was down in that time, or so shortly before that it still has an effect. If one end is
// taken down, the other has no carrier either.
std::optional<Part> Way::link_down(Stage stage, std::int64_t from_ns, std::int64_t to_ns,
                                   std::int64_t most_felt_ns) const {
  if (to_ns < from_ns) return {};  // by two clocks
  // Interfaces that were down at that time come first.
  for (const auto& [felt_ns, taken] :
       {std::pair(std::int64_t{0}, true), {0, false}, {most_felt_ns, true}, {most_felt_ns, false}})
    for (const auto* end : {&client_, &server_})
      for (const auto& down : end->downs) {
        const auto felt_until_ns = down.to_ns + felt_ns;
        const auto since_ns = down.from_ns - (taken ? reported_within_ns : carrier_reported_within_ns);
        if (down.taken != taken || since_ns > to_ns || felt_until_ns < from_ns) continue;
        const auto until_ns = std::min(to_ns, felt_until_ns);
        const Stretch when{std::clamp(down.from_ns, from_ns, until_ns), until_ns, State::unknown, -1};
        return Part{.cause = Cause::link_down,
                    .stage = stage,
                    .end = end->name,
                    .culprit = end->interface + (taken ? " was taken down" : " had no carrier"),
                    .ns = when.length_ns(),
                    .when = {when}};
      }
  return {};
}

// Whether the trace shows that the kernel had no route or neighbour for the end's first packet. A socket
// bound to an interface needs no route, and a neighbour may still answer: then the packet is sent, by the
// thread that received the neighbour's answer.
bool Way::not_sent(Delay& found, const End& from, std::int64_t from_ns) const {
  if (from.timeline == nullptr) return false;
  const auto& events = from.timeline->events();
  const auto* const sends = with(from, "send");
  const auto goes_after_all = [&](const Event& refused) {
    return std::any_of(events.begin(), events.end(), [&](const Event& event) {
      return event.kind == Kind::queued && event.bytes >= packet_bytes_ && event.at_ns >= refused.at_ns &&
             event.at_ns <= refused.at_ns + before_queue_ns;
    });
  };
  for (const auto& event : events) {
    const bool is_refusal = event.kind == Kind::no_route || event.kind == Kind::no_neighbour;
    const bool is_its =
        &from == &client_ ? sends != nullptr && event.thread.id == sends->id : from.has(event.thread.id);
    if (!is_refusal || !is_its || event.at_ns < from_ns ||
        event.at_ns > ran_from_ns(*from.timeline, event.thread.id, from_ns, event.at_ns) + before_queue_ns ||
        goes_after_all(event))
      continue;
    found.parts.push_back({.cause = Cause::unreachable,
                           .stage = Stage::left,
                           .end = from.name,
                           .culprit = event.kind == Kind::no_route ? "no route" : no_neighbour,
                           .when = {{event.at_ns, event.at_ns, State::unknown, -1}}});
    return true;
  }
  return false;
}

// Whether it is known where the message ended.
bool Way::lost_between(Delay& found, const End& from, const End& to, const Packet& way, std::int64_t from_ns,
                       std::int64_t until_ns) const {
  if (way.dropped != nullptr) {
    found.parts.push_back(drop_of(way, from, to));
    found.parts.back().when = {{way.dropped->at_ns, way.dropped->at_ns, State::unknown, -1}};
    return true;
  }
  if (way.queued == nullptr) {
    if (not_sent(found, from, from_ns)) return true;
    if (const auto* sends = with(from, "send"))
      thread(found, from, sends->id, "send", Stage::left, from_ns, until_ns);
    return found.held_ns > 0;
  }
  if (way.sent == nullptr) {
    held_in_queue(found, from, way, until_ns);
    return true;
  }
  return false;
}

// Whether a link that was down may explain the packet's end.
bool may_be_of_a_link(const Part& part) {
  return part.cause == Cause::unreachable ||
         (part.cause == Cause::dropped &&
          (part.culprit.starts_with("DEV_READY") || part.culprit.starts_with("__dev_forward_skb")));
}

// Adds the delay of kernel threads that should have received a sent packet: NAPI threads of the interface, or
// ksoftirqd of the CPU.
void Way::not_taken_in(Delay& found, const End& to, const Packet& packet, std::int64_t until_ns) const {
  if (to.timeline == nullptr || packet.sent == nullptr) return;
  constexpr std::size_t most_of_a_name = 15;  // that the kernel keeps
  const auto of_interface = ("napi/" + to.interface + "-").substr(0, most_of_a_name);
  const auto of_cpu = "ksoftirqd/" + std::to_string(packet.sent->cpu);
  std::map<std::int32_t, std::string> threads;
  for (const auto& event : to.timeline->events())
    for (const auto* thread : {&event.thread, &event.other})
      if ((!to.interface.empty() && thread->name.starts_with(of_interface)) || thread->name == of_cpu)
        threads[thread->id] = thread->name;
  for (const auto& [id, name] : threads)
    thread(found, to, id, name, Stage::travelled, packet.sent->at_ns, until_ns);
}

// How far a message is known to have come.
Part Way::last_seen(const Packet& there, const Packet& back) const {
  if (there.queued == nullptr) return {.stage = Stage::left, .end = client_.name};
  if (there.received == nullptr) return {.stage = Stage::travelled, .end = server_.name};
  if (back.queued == nullptr) return {.stage = Stage::delivered, .end = server_.name};
  return {.stage = back.received == nullptr ? Stage::travelled : Stage::delivered, .end = client_.name};
}

// What became of the answer to a message that came to the server's machine at `there_ns`.
Packet Way::answer_lost(Delay& found, std::int64_t there_ns, std::int64_t until_ns) const {
  auto back = lost_packet(server_, client_, there_ns, until_ns);
  if (back.queued == nullptr && back.dropped == nullptr) {
    if (!not_sent(found, server_, there_ns)) receiver(found, server_, there_ns, until_ns);
  } else if (!lost_between(found, server_, client_, back, there_ns, until_ns)) {
    if (back.received != nullptr)
      receiver(found, client_, back.received->at_ns, until_ns);
    else
      not_taken_in(found, client_, back, until_ns);
  }
  return back;
}

std::vector<Part> Way::loss_of(const roundtrip::Sample& sample, std::int64_t until_ns) {
  Delay found;
  const auto there = lost_packet(client_, server_, sample.sent_ns, until_ns);
  Packet back;
  if (!lost_between(found, client_, server_, there, sample.sent_ns, until_ns)) {
    if (there.received != nullptr)
      back = answer_lost(found, there.received->at_ns, until_ns);
    else
      not_taken_in(found, server_, there, until_ns);
  }
  // What held it up earlier counts if it was still held at the end.
  const auto lasts = [&](const Part& part) {
    return part.cause != Cause::waited &&
           std::ranges::any_of(part.when, [&](const Stretch& one) { return one.to_ns == until_ns; });
  };
  if (there.queued != nullptr && std::ranges::any_of(found.parts, lasts)) {
    passage(found, client_, server_, there, sample.sent_ns);
    if (back.queued != nullptr) receiver(found, server_, there.received->at_ns, back.queued->at_ns);
  }
  // A short delay did not lose it, unless its packet ended there; and a sleeping thread may wait for the next
  // message.
  std::erase_if(found.parts, [&](const Part& part) {
    const bool has_ended = part.cause == Cause::dropped || part.cause == Cause::unreachable ||
                           (part.cause == Cause::queue && lasts(part));
    return part.cause == Cause::waited || (!has_ended && part.ns < (until_ns - sample.sent_ns) / 2);
  });
  if (found.parts.empty()) {
    const auto sent_ns = there.received != nullptr ? there.received->at_ns : sample.sent_ns;
    const auto down = link_down(Stage::travelled, sent_ns, sent_ns, 0);
    found.parts.push_back(down.value_or(last_seen(there, back)));
    found.parts.back().ns = 0;
  }
  for (auto& part : found.parts) {
    if (!may_be_of_a_link(part)) continue;
    const auto at_ns = part.when.front().from_ns;
    const auto down = link_down(part.stage, at_ns, at_ns, part.culprit == no_neighbour ? forgotten_ns : 0);
    if (!down) continue;
    part.cause = down->cause;
    part.end = down->end;
    part.culprit = down->culprit;
  }
  std::ranges::stable_sort(found.parts, std::ranges::greater(), &Part::ns);
  return found.parts;
}

}  // namespace ontime::explain

// SPDX-License-Identifier: Apache-2.0
#include "explain/way.hpp"

#include <algorithm>
#include <numeric>

namespace ontime::explain {
namespace {

using trace::Event;
using trace::Kind;

constexpr std::int64_t surely_throttled_ns =
    10'000'000;  // longer than the kernel holds off a real-time thread
// Longer than a CPU that somebody has is not interrupted by its clock (10 ms at most): no hypervisor runs it.
constexpr std::int64_t surely_not_run_ns = 11'000'000;
constexpr std::int64_t slow_to_wake_ns = 1'000'000;  // longer than any idle state takes to leave
constexpr std::int64_t at_once_ns = 20'000;  // what packets and wake-ups take when nothing is in the way
constexpr std::int64_t before_queue_ns =
    1'000'000;  // within which a packet that is sent is queued or dropped
// After a link was taken down, or had no carrier any more, the news of it, at most: of the latter the kernel
// tells once a second.
constexpr std::int64_t told_late_ns = 20'000'000, of_carrier_told_late_ns = 1'000'000'000;
constexpr std::int64_t of_a_page_ns = 200'000;  // what the kernel does at most of itself to fetch one
constexpr std::int64_t fragment_bytes = 1000;   // of a message that takes several packets
// Who has an address is forgotten when a link goes down, and once it is asked who has it, then anew once a
// second.
constexpr std::int64_t forgotten_ns = 3'000'000'000;
const std::string sigstop = "19", sigtstp = "20", no_neighbour = "no neighbour";

bool is_interrupts(const std::string& name) { return name.starts_with("irq/"); }

bool is_kernels(const std::string& name) {
  return name.starts_with("ksoftirqd/") || name.starts_with("napi/") || is_interrupts(name);
}

bool brings_packets(const Timeline& timeline, const Waker& waker) {
  return waker.interrupt == "NET_RX" || is_kernels(timeline.name_of(waker.thread));
}

bool has(const End& end, std::int32_t thread) {
  return std::any_of(end.threads.begin(), end.threads.end(),
                     [&](const KnownThread& known) { return known.id == thread; });
}

bool has_run(const Timeline& timeline, std::int32_t thread, std::int64_t from_ns, std::int64_t to_ns) {
  const auto stretches = timeline.of(thread, from_ns, to_ns);
  return std::any_of(stretches.begin(), stretches.end(), [](const Stretch& stretch) {
    return stretch.state == State::runs || stretch.state == State::comes;
  });
}

// Until it does, what it has to do waits.
std::int64_t ran_from_ns(const Timeline& timeline, std::int32_t thread, std::int64_t from_ns,
                         std::int64_t to_ns) {
  for (const auto& stretch : timeline.of(thread, from_ns, to_ns))
    if (stretch.state == State::runs || stretch.state == State::comes) return stretch.from_ns;
  return from_ns;
}

// Between two waits for pages a thread comes to its CPU and runs for the next of them, if that is short; it
// is one cause.
bool fetches_pages(const Timeline& timeline, std::int32_t id, const std::vector<Stretch>& stretches,
                   std::size_t place) {
  const auto waits_for_a_page = [&](const Stretch& stretch) {
    return stretch.state == State::blocked &&
           cause_of_wait(timeline.waited_in(id, stretch.to_ns)) == Cause::page_fault;
  };
  const auto is_beside = [](const Stretch& stretch) {
    return stretch.state != State::ready && stretch.state != State::runs && stretch.state != State::comes;
  };
  const auto here = stretches.begin() + static_cast<std::ptrdiff_t>(place);
  if (is_beside(*here)) return false;
  const auto after = std::find_if(here, stretches.end(), is_beside);
  const auto before = std::find_if(std::make_reverse_iterator(here), stretches.rend(), is_beside);
  if (before == stretches.rend() || after == stretches.end() || !waits_for_a_page(*before) ||
      !waits_for_a_page(*after))
    return false;
  std::int64_t between_ns = 0;
  for (auto one = before.base(); one != after; ++one) between_ns += one->length_ns();
  return between_ns <= of_a_page_ns;
}

// Who stopped a process: the kernel names one of its threads.
std::string who_stopped(const Timeline& timeline, std::int64_t before_ns) {
  std::string who;
  for (const auto& event : timeline.events())
    if (event.kind == Kind::signal && event.at_ns <= before_ns &&
        (event.what == sigstop || event.what == sigtstp))
      who = timeline.name_of(event.other.id);
  return who;
}

}  // namespace

// Whether any packet that went from one end's interface came to the other's as the same, as between two
// network namespaces; over a wire it is another.
bool hands_packets_over(const End& one, const End& other) {
  if (one.timeline == nullptr || one.timeline->events().empty()) return false;
  const auto anybody = [](std::int32_t) { return true; };
  const auto is_of = [](const std::string& interface, const Event& event) {
    return interface.empty() ? event.what != "lo" : event.what == interface;
  };
  const auto& events = one.timeline->events();
  const auto packets = packets_of(*one.timeline, anybody, true, events.front().at_ns, events.back().at_ns);
  return std::any_of(packets.begin(), packets.end(), [&](const Packet& packet) {
    const auto goes = [&](const End& from, const End& to) {
      return is_of(from.interface, *packet.queues.back().in) && is_of(to.interface, *packet.received) &&
             packet.queues.back().in->what != packet.received->what;
    };
    return packet.received != nullptr && !packet.queues.empty() && (goes(one, other) || goes(other, one));
  });
}

Way::Way(End client, End server, const Usual& usual, std::int64_t payload_bytes, bool one_machine)
    : client_(std::move(client)),
      server_(std::move(server)),
      usual_(usual),
      packet_bytes_(std::min(payload_bytes, fragment_bytes)),
      one_machine_(one_machine),
      is_handed_over_(one_machine && hands_packets_over(client_, server_)) {}

void Way::add(Found& found, const Part& part, const Stretch& when) const {
  add(found, part, when.length_ns(), {when});
}

void Way::add(Found& found, Part part, std::int64_t ns, const std::vector<Stretch>& when) const {
  if (ns <= 0) return;
  found.held_ns += ns;
  const auto same = std::find_if(found.parts.begin(), found.parts.end(), [&](const Part& other) {
    return other.cause == part.cause && other.stage == part.stage && other.end == part.end &&
           other.thread == part.thread && other.culprit == part.culprit;
  });
  if (same != found.parts.end()) {
    same->ns += ns;
    same->when.insert(same->when.end(), when.begin(), when.end());
    for (const auto thread : part.culprit_threads)
      if (std::find(same->culprit_threads.begin(), same->culprit_threads.end(), thread) ==
          same->culprit_threads.end())
        same->culprit_threads.push_back(thread);
    return;
  }
  part.ns = ns;
  part.when = when;
  found.parts.push_back(std::move(part));
}

// Until when a thread was ready and passed over: then at the latest the scheduler let its CPU idle.
std::int64_t passed_over_until_ns(const std::vector<Held>& holders, const Stretch& stretch) {
  auto until_ns = stretch.from_ns;
  for (const auto& held : holders)
    if (held.thread.id == 0 && held.surely && held.from_ns > stretch.from_ns + at_once_ns &&
        held.to_ns - held.from_ns >= slow_to_wake_ns)
      until_ns = held.to_ns;
  return until_ns;
}

bool is_outranked(const Held& held, std::int32_t priority) {
  return held.surely && held.thread.id != 0 && priority < trace::least_ordinary &&
         held.thread.priority >= trace::least_ordinary;
}

// In the whole of a wait, of which a thread that is moved from CPU to CPU has several stretches.
std::int64_t outranked_in(const Timeline& timeline, const std::vector<Stretch>& stretches, std::size_t place,
                          std::int32_t priority) {
  const auto is_other = [](const Stretch& stretch) { return stretch.state != State::ready; };
  const auto here = stretches.begin() + static_cast<std::ptrdiff_t>(place);
  auto one = std::find_if(std::make_reverse_iterator(here), stretches.rend(), is_other).base();
  std::int64_t sum_ns = 0;
  for (; one != stretches.end() && !is_other(*one); ++one)
    for (const auto& held : timeline.holders(one->cpu, one->from_ns, one->to_ns))
      if (is_outranked(held, priority)) sum_ns += held.to_ns - held.from_ns;
  return sum_ns;
}

// Ready, and not running: by who had the CPU that it was to run on.
void Way::waited(Found& found, const Timeline& timeline, const Part& whose, const Stretch& stretch,
                 std::int64_t outranked_ns) const {
  auto left_ns = stretch.length_ns();
  const auto holders = timeline.holders(stretch.cpu, stretch.from_ns, stretch.to_ns);
  const auto passed_over_ns = passed_over_until_ns(holders, stretch);
  for (const auto& held : holders) {
    auto part = whose;
    const Stretch when{held.from_ns, held.to_ns, State::ready, stretch.cpu};
    auto ns = when.length_ns();
    if (!held.surely) continue;
    left_ns -= ns;
    if (held.thread.id == 0) {
      const bool kept = stretch.length_ns() >= slow_to_wake_ns &&
                        timeline.lives(stretch.cpu, stretch.from_ns + at_once_ns, stretch.to_ns - at_once_ns);
      part.cause = kept ? Cause::throttled : Cause::idle_cpu;
      add(found, part, when);
      continue;
    }
    for (const auto& interrupt : timeline.interrupts(stretch.cpu, held.from_ns, held.to_ns)) {
      auto by = whose;
      by.cause = Cause::interrupts;
      by.culprit = interrupt.what;
      add(found, by, {interrupt.from_ns, interrupt.to_ns, State::ready, stretch.cpu});
      ns -= interrupt.to_ns - interrupt.from_ns;
    }
    // A CPU that another has for so long is interrupted by its clock now and then; one that no hypervisor
    // runs is not.
    const bool is_dead = is_outranked(held, whose.priority) &&
                         timeline.silence_ns(stretch.cpu, held.from_ns, held.to_ns) >= surely_not_run_ns;
    const bool is_passed_over = held.thread.priority >= trace::least_ordinary && held.to_ns <= passed_over_ns;
    part.cause =
        is_dead ? Cause::idle_cpu
        : is_passed_over || (is_outranked(held, whose.priority) && outranked_ns >= surely_throttled_ns)
            ? Cause::throttled
            : Cause::cpu;
    if (part.cause == Cause::cpu) {
      part.culprit = held.thread.name.empty() ? timeline.name_of(held.thread.id) : held.thread.name;
      part.culprit_threads = {held.thread.id};
      part.culprit_priority = held.thread.priority;
    }
    add(found, part, ns, {when});
  }
  auto part = whose;
  part.cause = Cause::unknown;
  add(found, part, left_ns, {});
}

void Way::thread(Found& found, const End& end, std::int32_t id, const std::string& role, Stage stage,
                 std::int64_t from_ns, std::int64_t to_ns) const {
  if (end.timeline == nullptr || to_ns <= from_ns) return;
  const auto& timeline = *end.timeline;
  const Part whose{
      .stage = stage, .end = end.name, .thread = role, .thread_id = id, .priority = timeline.priority_of(id)};
  found.last = whose;
  bool begun = false;
  const auto accuse = [&](Part& part, const std::optional<Waker>& waker) {
    if (!waker || !waker->interrupt.empty() || waker->thread == 0 || waker->thread == id) return;
    part.culprit = timeline.name_of(waker->thread);
    part.culprit_threads = {waker->thread};
  };
  const auto stretches = timeline.of(id, from_ns, to_ns);
  for (std::size_t place = 0; place < stretches.size(); ++place) {
    const auto& stretch = stretches[place];
    auto part = whose;
    if (fetches_pages(timeline, id, stretches, place)) {
      part.cause = Cause::page_fault;
      add(found, part, stretch);
      continue;
    }
    switch (stretch.state) {
      case State::ready:
        waited(found, timeline, whose, stretch, outranked_in(timeline, stretches, place, whose.priority));
        break;
      case State::runs:
        found.ran_ns += stretch.length_ns();
        found.ran.push_back(stretch);
        for (const auto& interrupt : timeline.interrupts(stretch.cpu, stretch.from_ns, stretch.to_ns)) {
          part.cause = Cause::interrupts;
          part.culprit = interrupt.what;
          add(found, part, {interrupt.from_ns, interrupt.to_ns, State::runs, stretch.cpu});
          found.ran_ns -= interrupt.to_ns - interrupt.from_ns;
        }
        break;
      case State::stopped:
        part.cause = Cause::stopped;
        part.culprit = who_stopped(timeline, stretch.to_ns);
        add(found, part, stretch);
        break;
      case State::blocked:
        part.cause = cause_of_wait(timeline.waited_in(id, stretch.to_ns));
        if (part.cause == Cause::lock) accuse(part, timeline.waker_of(id, stretch.to_ns));
        add(found, part, stretch);
        break;
      case State::sleeps: {
        if (!begun) {
          found.slept.push_back(stretch);
          break;
        }
        const auto waker = timeline.waker_of(id, stretch.to_ns);
        // Of the kernel's threads, and of what a packet woke, sleep says that there was nothing to do yet.
        if (is_kernels(role) || (waker && brings_packets(timeline, *waker))) break;
        part.cause = Cause::waited;
        accuse(part, waker);
        add(found, part, stretch);
        break;
      }
      case State::comes:
      case State::gone:
      case State::unknown:
        break;
    }
    begun = begun || stretch.state == State::runs || stretch.state == State::comes;
  }
}

const KnownThread* Way::with(const End& end, const std::string& role) {
  const auto found = std::find_if(end.threads.begin(), end.threads.end(),
                                  [&](const KnownThread& thread) { return thread.role == role; });
  return found == end.threads.end() ? nullptr : &*found;
}

// A middleware has several: the one that ran when the message was there, or else one that should have.
const KnownThread* Way::receives(const End& end, std::int64_t at_ns) const {
  if (end.timeline == nullptr) return nullptr;
  const KnownThread* best = nullptr;
  for (const auto& thread : end.threads) {
    if (thread.role != "receive" && thread.role != "delivery") continue;
    const auto state = end.timeline->state_at(thread.id, at_ns);
    if (state == State::runs || state == State::comes) return &thread;
    if (best == nullptr || (state && *state != State::sleeps)) best = &thread;
  }
  return best;
}

// From the packet's arrival on, by the threads of the end that hand it on, the last first.
void Way::receiver(Found& found, const End& end, std::int64_t from_ns, std::int64_t to_ns) const {
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
    // One that had begun with the message already waits for a lock, or for what another does for it.
    const bool had_begun = woken != nullptr && has_run(*end.timeline, id, from_ns, woken->at_ns);
    const bool by_another = woken != nullptr && !had_begun && woken->other.id != id &&
                            has(end, woken->other.id) &&
                            end.timeline->state_at(woken->other.id, woken->at_ns) == State::runs;
    thread(found, end, id, role, Stage::delivered, by_another ? woken->at_ns : from_ns, to_ns);
    if (!by_another) return;
    to_ns = woken->at_ns;
    id = woken->other.id;
    role = std::find_if(end.threads.begin(), end.threads.end(), [&](const KnownThread& known) {
             return known.id == id;
           })->role;
  }
}

// The first that is large enough, or that was thrown away before there was any.
Packet Way::packet(const End& from, const End& to, std::int64_t from_ns, std::int64_t to_ns) const {
  if (from.timeline == nullptr) return {};
  const auto ours = [&](std::int32_t thread) { return has(from, thread); };
  Packet packet;
  for (const auto& one : packets_of(*from.timeline, ours, is_handed_over_, from_ns, to_ns)) {
    const bool fits = one.queued != nullptr ? one.queued->bytes >= packet_bytes_
                                            : one.dropped->at_ns < from_ns + before_queue_ns;
    if (!fits) continue;
    packet = one;
    break;
  }
  if (is_handed_over_ || packet.sent == nullptr || to.timeline == nullptr) return packet;
  // Over a wire: the last of its size that had come.
  for (const auto& event : to.timeline->events()) {
    const bool is_its = event.kind == Kind::received && event.bytes >= packet_bytes_ &&
                        (!one_machine_ || event.what == to.interface);
    if (is_its && event.at_ns <= to_ns && event.at_ns >= packet.sent->at_ns - usual_.uncertainty_ns(from_ns))
      packet.received = &event;
  }
  return packet;
}

void Way::held_in_queue(Found& found, const End& from, const Packet& packet, std::int64_t until_ns) const {
  for (const auto& [in, out] : packet.queues) {
    const auto out_ns = out != nullptr ? out->at_ns : until_ns;
    if (out_ns - in->at_ns <= at_once_ns) continue;
    add(found, {.cause = Cause::queue, .stage = Stage::queued, .end = from.name, .culprit = in->what},
        {in->at_ns, out_ns, State::unknown, -1});
  }
}

// By the kernel's threads that take it in, the last first: NAPI's may be woken by an interrupt's. Who ran
// when that was woken was only interrupted.
void Way::brought(Found& found, const End& to, std::int32_t id, std::int64_t from_ns,
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

void Way::leg(Found& found, const End& from, const End& to, std::int64_t from_ns, std::int64_t to_ns) const {
  const auto way = packet(from, to, from_ns, to_ns);
  if (way.queued == nullptr || way.dropped != nullptr) {
    receiver(found, to, from_ns, to_ns);
    return;
  }
  const auto known = std::find_if(from.threads.begin(), from.threads.end(),
                                  [&](const auto& thread) { return thread.id == way.queued->thread.id; });
  thread(found, from, known->id, known->role, Stage::left, from_ns, way.queued->at_ns);
  if (way.sent == nullptr) {
    receiver(found, to, way.queued->at_ns, to_ns);
    return;
  }
  held_in_queue(found, from, way, way.sent->at_ns);
  if (way.received == nullptr) {
    receiver(found, to, way.sent->at_ns, to_ns);
    return;
  }
  brought(found, to, way.received->thread.id, way.sent->at_ns, way.received->at_ns);
  receiver(found, to, way.received->at_ns, to_ns);
}

// Which interface could carry nothing in that time, or so shortly before it that this is felt still. Where
// one is taken down the other end has no carrier either.
std::optional<Part> Way::link_down(Stage stage, std::int64_t from_ns, std::int64_t to_ns,
                                   std::int64_t most_felt_ns) const {
  if (to_ns < from_ns) return {};  // by two clocks
  // First those that were down then.
  for (const auto& [felt_ns, taken] :
       {std::pair(std::int64_t{0}, true), {0, false}, {most_felt_ns, true}, {most_felt_ns, false}})
    for (const auto* end : {&client_, &server_})
      for (const auto& down : end->downs) {
        const auto felt_until_ns = down.to_ns + felt_ns;
        const auto since_ns = down.from_ns - (taken ? told_late_ns : of_carrier_told_late_ns);
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

// Whether a neighbour was asked who has the address.
bool is_sought_by(const End& from, const Leg& times) {
  if (from.timeline == nullptr) return false;
  const auto& events = from.timeline->events();
  return std::any_of(events.begin(), events.end(), [&](const Event& event) {
    return event.kind == Kind::no_neighbour && has(from, event.thread.id) && times.from_ns <= event.at_ns &&
           event.at_ns <= times.to_ns;
  });
}

// What is over the usual, and no state of a thread or packet accounts for.
void Way::rest(Found& found, std::size_t leg, const Leg& times) const {
  auto left_ns = times.length_ns() - found.held_ns - usual_.leg_ns(leg);
  const auto take = [&](Cause cause, std::int64_t most_ns, const std::vector<Stretch>& when) {
    const auto ns = std::min(left_ns, most_ns);
    auto part = found.last;
    part.cause = cause;
    add(found, part, ns, when);
    left_ns -= std::max<std::int64_t>(ns, 0);
  };
  const auto slept_ns =
      std::accumulate(found.slept.begin(), found.slept.end(), std::int64_t{0},
                      [](std::int64_t sum, const Stretch& stretch) { return sum + stretch.length_ns(); });
  constexpr std::size_t waking = 0, sending = 1, answering = 3;
  if (leg == waking) take(Cause::timer, slept_ns, found.slept);
  take(Cause::busy, found.ran_ns, found.ran);
  if (leg == sending || leg == answering) take(Cause::waited, slept_ns, found.slept);
  constexpr std::size_t there = 2, back = 4;
  const bool travels = leg == there || leg == back;
  const bool is_sought = travels && is_sought_by(leg == there ? client_ : server_, times);
  const auto down =
      travels ? link_down(Stage::travelled, times.from_ns, times.to_ns, is_sought ? forgotten_ns : 0)
              : std::nullopt;
  if (down) {
    const auto ns = std::min(left_ns, down->ns);
    add(found, *down, ns, down->when);
    left_ns -= std::max<std::int64_t>(ns, 0);
  }
  take(Cause::unknown, left_ns, {});
}

std::vector<Part> Way::delays_of(const roundtrip::Sample& sample) {
  std::vector<Part> all;
  const auto way = usual_.of(sample);
  for (std::size_t number = 0; number < legs; ++number) {
    const auto [from_ns, to_ns] = way[number];
    Found found;
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
  std::stable_sort(all.begin(), all.end(),
                   [](const Part& one, const Part& other) { return one.ns > other.ns; });
  return all;
}

// Whether the kernel is known to have had no way for what the end sent first. A socket may be bound to an
// interface and need no route, and a neighbour may answer: then a packet goes after all, by whoever took in
// the neighbour's answer.
bool Way::not_sent(Found& found, const End& from, std::int64_t from_ns) const {
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
    const bool tells = event.kind == Kind::no_route || event.kind == Kind::no_neighbour;
    const bool is_its =
        &from == &client_ ? sends != nullptr && event.thread.id == sends->id : has(from, event.thread.id);
    if (!tells || !is_its || event.at_ns < from_ns ||
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
bool Way::lost_between(Found& found, const End& from, const End& to, const Packet& way, std::int64_t from_ns,
                       std::int64_t until_ns) const {
  if (way.dropped != nullptr) {
    const bool here = way.sent == nullptr || !one_machine_;
    found.parts.push_back({.cause = Cause::dropped,
                           .stage = way.received != nullptr ? Stage::delivered
                                    : way.sent == nullptr   ? Stage::queued
                                                            : Stage::travelled,
                           .end = here ? from.name : to.name,
                           .culprit = way.dropped->what,
                           .when = {{way.dropped->at_ns, way.dropped->at_ns, State::unknown, -1}}});
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

// Whether what became of a packet may be for want of a link.
bool may_be_of_a_link(const Part& part) {
  return part.cause == Cause::unreachable ||
         (part.cause == Cause::dropped &&
          (part.culprit.starts_with("DEV_READY") || part.culprit.starts_with("__dev_forward_skb")));
}

std::vector<Part> Way::loss_of(const roundtrip::Sample& sample, std::int64_t until_ns) {
  Found found;
  const auto there = packet(client_, server_, sample.sent_ns, until_ns);
  if (!lost_between(found, client_, server_, there, sample.sent_ns, until_ns) && there.received != nullptr) {
    const auto back = packet(server_, client_, there.received->at_ns, until_ns);
    if (back.queued == nullptr && back.dropped == nullptr) {
      if (!not_sent(found, server_, there.received->at_ns))
        receiver(found, server_, there.received->at_ns, until_ns);
    } else if (!lost_between(found, server_, client_, back, there.received->at_ns, until_ns) &&
               back.received != nullptr)
      receiver(found, client_, back.received->at_ns, until_ns);
  }
  // What let it go on soon is not what lost it; and one that sleeps may wait for the next.
  std::erase_if(found.parts, [&](const Part& part) {
    return part.cause == Cause::waited || (part.cause != Cause::dropped && part.cause != Cause::unreachable &&
                                           part.ns < (until_ns - sample.sent_ns) / 2);
  });
  if (found.parts.empty()) {
    const auto sent_ns = there.received != nullptr ? there.received->at_ns : sample.sent_ns;
    const auto down = link_down(Stage::travelled, sent_ns, sent_ns, 0);
    found.parts.push_back(down.value_or(Part{.stage = Stage::delivered, .end = server_.name}));
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
  std::stable_sort(found.parts.begin(), found.parts.end(),
                   [](const Part& one, const Part& other) { return one.ns > other.ns; });
  return found.parts;
}

}  // namespace ontime::explain

// SPDX-License-Identifier: Apache-2.0
#include "explain/timeline.hpp"

#include <algorithm>
#include <charconv>
#include <cstdlib>

namespace ontime::explain {
namespace {

using trace::Event;
using trace::Kind;

State state_of(const std::string& letter) {
  if (letter.empty()) return State::unknown;
  if (letter == "R") return State::ready;
  if (letter == "D") return State::blocked;
  if (letter == "T") return State::stopped;
  if (letter == "t") return State::traced;
  if (letter == "X" || letter == "Z") return State::gone;
  return State::sleeps;
}

int cpu_of(const std::string& text) {
  int cpu = -1;
  std::from_chars(text.data(), text.data() + text.size(), cpu);
  return cpu;
}

// The state of a thread after an event, and the state that it must have had before.
struct Change {
  State before, after;
  int cpu;
};
std::optional<Change> change_of(const Event& event, std::int32_t thread, State now) {
  if (event.kind == Kind::switched && event.thread.id == thread)
    return Change{State::runs, state_of(event.what), event.cpu};
  if (event.kind == Kind::switched && event.other.id == thread)
    return Change{State::ready, State::runs, event.cpu};
  const bool is_awake = now == State::runs || now == State::comes || now == State::ready;
  if (event.kind == Kind::waking && event.thread.id == thread && !is_awake)
    return Change{State::sleeps, State::ready, cpu_of(event.what)};
  if (event.kind == Kind::moved && event.thread.id == thread &&
      (now == State::ready || now == State::unknown))
    return Change{State::ready, State::ready, cpu_of(event.what)};
  return {};
}

// The name and priority of a running thread may change; its highest priority counts.
trace::Thread as_it_left(trace::Thread came, const trace::Thread& left) {
  if (left.id != came.id) return came;
  if (!left.name.empty()) came.name = left.name;
  came.priority = std::min(came.priority, left.priority);
  return came;
}

bool begins(Kind kind) {
  return kind == Kind::interrupt || kind == Kind::soft_interrupt || kind == Kind::timer;
}
bool ends(Kind kind) {
  return kind == Kind::interrupt_end || kind == Kind::soft_interrupt_end || kind == Kind::timer_end;
}

bool is_of_timer(const Event& event) {
  return event.kind == Kind::timer ||
         (event.kind == Kind::interrupt && event.what.find("timer") != std::string::npos);
}

// The period of the kernel's tick (CONFIG_HZ): the most frequent of Linux' possible periods between two timer
// interrupts of a CPU. If they do not show it, the longest.
std::int64_t tick_of(const std::vector<Event>& events) {
  constexpr std::int64_t periods_ns[] = {1'000'000, 3'333'333, 4'000'000, 10'000'000};
  constexpr int surely_some = 3;
  std::map<std::int64_t, int> seen;
  std::map<int, std::int64_t> last;  // by CPU
  for (const auto& event : events) {
    if (!is_of_timer(event)) continue;
    const auto [before, is_first] = last.try_emplace(event.cpu, event.at_ns);
    const auto gap_ns = event.at_ns - before->second;
    before->second = event.at_ns;
    for (const auto period_ns : periods_ns)
      if (!is_first && std::abs(gap_ns - period_ns) <= period_ns / 50) ++seen[period_ns];
  }
  const auto most = std::ranges::max_element(seen, {}, [](const auto& one) { return one.second; });
  return most == seen.end() || most->second < surely_some ? std::end(periods_ns)[-1] : most->first;
}

}  // namespace

Timeline::Timeline(const trace::Window& window, std::int64_t later_ns)
    : begin_ns_(window.span.from_ns + later_ns),
      events_(window.events),
      tick_ns_(tick_of(events_)),
      sees_timers_(std::ranges::any_of(events_, is_of_timer)) {
  for (auto& event : events_) event.at_ns += later_ns;
  scheduling_ = scheduling_of(events_, begin_ns_);
  find_interrupts();
}

// Computed once: every stretch of a thread needs it. Nested interrupts count once, as the outermost. With
// PREEMPT_RT a thread may lose its CPU inside a softirq: that goes on when the thread returns.
void Timeline::find_interrupts() {
  struct Open {
    int depth = 0;
    Interrupted now{};
  };
  std::map<int, Open> open;                                // by CPU
  std::map<std::pair<int, std::int32_t>, Open> preempted;  // by CPU and thread
  for (const auto& event : events_) {
    if (event.at_ns < begin_ns_) continue;
    auto& here = open[event.cpu];
    const auto close = [&] {
      here.now.to_ns = event.at_ns;
      interrupts_[event.cpu].push_back(here.now);
    };
    if (event.kind == Kind::switched) {
      if (here.depth > 0) {
        close();
        preempted[{event.cpu, event.thread.id}] = here;
      }
      const auto back = preempted.extract({event.cpu, event.other.id});
      here = back.empty() ? Open{} : back.mapped();
      here.now.from_ns = event.at_ns;
    }
    if (begins(event.kind) && here.depth++ == 0)
      here.now = {event.at_ns, 0, event.kind == Kind::timer ? "timer interrupt" : event.what,
                  event.kind == Kind::soft_interrupt};
    if (ends(event.kind) && here.depth > 0 && --here.depth == 0) close();
  }
}

std::vector<Stretch> Timeline::of(std::int32_t thread, std::int64_t from_ns, std::int64_t to_ns) const {
  std::vector<Stretch> stretches;
  State now = State::unknown;
  int cpu = -1;
  auto since_ns = from_ns, surely_ns = from_ns;
  const auto until = [&](std::int64_t end_ns, State state, int where) {
    if (state == State::comes && surely_ns < end_ns) {
      if (surely_ns > since_ns) stretches.push_back({since_ns, surely_ns, state, where});
      since_ns = std::max(since_ns, surely_ns);
      state = State::runs;
    }
    if (end_ns > since_ns) stretches.push_back({since_ns, end_ns, state, where});
    since_ns = std::max(since_ns, end_ns);
  };
  bool seen = false;
  for (const auto& [event, latest_ns] : scheduling_) {
    if (event.at_ns >= to_ns && seen) break;
    const auto change = change_of(event, thread, now);
    if (!change) continue;
    seen = true;
    const bool inferred = now == State::unknown;
    until(std::min(event.at_ns, to_ns), inferred ? change->before : now, inferred ? change->cpu : cpu);
    if (event.at_ns >= to_ns) return stretches;
    now = latest_ns > event.at_ns ? State::comes : change->after;
    surely_ns = latest_ns;
    cpu = change->cpu;
  }
  // Each window begins with an event for every thread that does not sleep.
  until(to_ns, seen ? now : State::sleeps, cpu);
  return stretches;
}

std::optional<State> Timeline::state_at(std::int32_t thread, std::int64_t at_ns) const {
  const auto stretches = of(thread, at_ns, at_ns + 1);
  return stretches.empty() ? std::nullopt : std::optional(stretches.front().state);
}

std::vector<Held> Timeline::holders(int cpu, std::int64_t from_ns, std::int64_t to_ns) const {
  std::vector<Held> holders;
  std::optional<trace::Thread> now;
  auto since_ns = from_ns, surely_ns = from_ns;
  const auto until = [&](std::int64_t end_ns, const trace::Thread& thread) {
    for (const bool surely : {false, true}) {
      const auto part_ns = surely ? end_ns : std::min(surely_ns, end_ns);
      if (part_ns <= since_ns) continue;
      holders.push_back({since_ns, part_ns, thread, surely});
      since_ns = part_ns;
    }
  };
  for (const auto& [event, latest_ns] : scheduling_) {
    if (event.kind != Kind::switched || event.cpu != cpu) continue;
    until(std::min(event.at_ns, to_ns), now ? as_it_left(*now, event.thread) : event.thread);
    now = event.other;
    surely_ns = latest_ns;
    if (event.at_ns >= to_ns) break;
  }
  if (now) until(to_ns, *now);
  return holders;
}

std::vector<Interrupted> Timeline::interrupts(int cpu, std::int64_t from_ns, std::int64_t to_ns) const {
  std::vector<Interrupted> all;
  const auto there = interrupts_.find(cpu);
  if (there == interrupts_.end()) return all;
  auto next = std::partition_point(there->second.begin(), there->second.end(),
                                   [&](const Interrupted& one) { return one.to_ns <= from_ns; });
  for (; next != there->second.end() && next->from_ns < to_ns; ++next) {
    auto clipped = *next;
    clipped.from_ns = std::max(clipped.from_ns, from_ns);
    clipped.to_ns = std::min(clipped.to_ns, to_ns);
    if (clipped.to_ns > clipped.from_ns) all.push_back(clipped);
  }
  return all;
}

std::vector<Interrupted> Timeline::reclaims(std::int32_t thread, std::int64_t from_ns,
                                            std::int64_t to_ns) const {
  std::vector<Interrupted> all;
  auto since_ns = from_ns;
  for (const auto& event : events_) {
    if (event.thread.id != thread) continue;
    if (event.kind == Kind::reclaim) since_ns = event.at_ns;
    if (event.kind != Kind::reclaim_end) continue;
    const Interrupted one{std::max(since_ns, from_ns), std::min(event.at_ns, to_ns), "reclaim", false};
    if (one.to_ns > one.from_ns) all.push_back(one);
  }
  return all;
}

const Event* Timeline::last_switch(int cpu, std::int64_t at_ns) const {
  const auto end = std::partition_point(scheduling_.begin(), scheduling_.end(),
                                        [&](const Scheduled& one) { return one.event.at_ns <= at_ns; });
  const auto last = std::find_if(
      std::make_reverse_iterator(end), scheduling_.rend(),
      [&](const Scheduled& one) { return one.event.kind == Kind::switched && one.event.cpu == cpu; });
  return last == scheduling_.rend() || last->latest_ns > last->event.at_ns ? nullptr : &last->event;
}

bool Timeline::thawed(std::int32_t by, std::int64_t from_ns, std::int64_t to_ns) const {
  return std::ranges::any_of(events_, [&](const Event& event) {
    return event.kind == Kind::thaw && event.thread.id == by && event.at_ns >= from_ns &&
           event.at_ns <= to_ns;
  });
}

std::int64_t Timeline::silence_ns(int cpu, std::int64_t from_ns, std::int64_t to_ns) const {
  std::int64_t longest_ns = 0;
  auto since_ns = from_ns;
  for (const auto& event : events_) {
    if (event.cpu != cpu || event.at_ns <= from_ns || event.at_ns >= to_ns) continue;
    longest_ns = std::max(longest_ns, event.at_ns - since_ns);
    since_ns = event.at_ns;
  }
  return std::max(longest_ns, to_ns - since_ns);
}

// Since it last left its CPU.
const Event* Timeline::last_of_its_wait(Kind kind, std::int32_t thread, std::int64_t until_ns) const {
  const Event* last = nullptr;
  for (const auto& event : events_) {
    if (event.at_ns > until_ns) break;
    if (event.thread.id != thread) continue;
    if (event.kind == kind)
      last = &event;
    else if (event.kind == Kind::switched)
      last = nullptr;
  }
  return last;
}

std::optional<Waker> Timeline::waker_of(std::int32_t thread, std::int64_t until_ns) const {
  const auto* woken = last_of_its_wait(Kind::waking, thread, until_ns);
  if (woken == nullptr) return {};
  const auto interrupted = interrupts(woken->cpu, woken->at_ns, woken->at_ns + 1);
  return Waker{woken->other.id, interrupted.empty() ? "" : interrupted.front().what};
}

std::string Timeline::waited_in(std::int32_t thread, std::int64_t until_ns) const {
  const auto* waits = last_of_its_wait(Kind::waits, thread, until_ns);
  return waits == nullptr ? "" : waits->what;
}

std::int32_t Timeline::priority_of(std::int32_t thread) const {
  auto priority = ordinary_priority;
  for (const auto& event : events_) {
    if (event.kind == Kind::switched && event.other.id == thread) priority = event.other.priority;
    const bool says = event.kind == Kind::switched || event.kind == Kind::waking || event.kind == Kind::moved;
    if (says && event.thread.id == thread) priority = event.thread.priority;
  }
  return priority;
}

std::string Timeline::name_of(std::int32_t thread) const {
  for (const auto& event : events_) {
    if (event.thread.id == thread && !event.thread.name.empty()) return event.thread.name;
    if (event.other.id == thread && !event.other.name.empty()) return event.other.name;
  }
  return "";
}

}  // namespace ontime::explain

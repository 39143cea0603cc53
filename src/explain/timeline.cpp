// SPDX-License-Identifier: Apache-2.0
#include "explain/timeline.hpp"

#include <algorithm>
#include <charconv>

namespace ontime::explain {
namespace {

using trace::Event;
using trace::Kind;

constexpr std::int32_t ordinary = 120;  // the kernel's priority of SCHED_OTHER, nice 0

State state_of(const std::string& letter) {
  if (letter == "R") return State::ready;
  if (letter == "D") return State::blocked;
  if (letter == "T" || letter == "t") return State::stopped;
  if (letter == "X" || letter == "Z") return State::gone;
  return State::sleeps;
}

int cpu_of(const std::string& text) {
  int cpu = -1;
  std::from_chars(text.data(), text.data() + text.size(), cpu);
  return cpu;
}

// What an event makes of a thread, and what it must have been at before.
struct Change {
  State before, after;
  int cpu;
};
std::optional<Change> change_of(const Event& event, std::int32_t thread, State now) {
  if (event.kind == Kind::switched && event.thread.id == thread)
    return Change{State::runs, state_of(event.what), event.cpu};
  if (event.kind == Kind::switched && event.other.id == thread)
    return Change{State::ready, State::runs, event.cpu};
  if (event.kind == Kind::waking && event.thread.id == thread && now != State::runs && now != State::ready)
    return Change{State::sleeps, State::ready, cpu_of(event.what)};
  return {};
}

bool begins(Kind kind) {
  return kind == Kind::interrupt || kind == Kind::soft_interrupt || kind == Kind::timer;
}
bool ends(Kind kind) {
  return kind == Kind::interrupt_end || kind == Kind::soft_interrupt_end || kind == Kind::timer_end;
}

}  // namespace

Timeline::Timeline(const trace::Window& window, std::int64_t later_ns) : events_(window.events) {
  for (auto& event : events_) event.at_ns += later_ns;
}

std::vector<Stretch> Timeline::of(std::int32_t thread, std::int64_t from_ns, std::int64_t to_ns) const {
  std::vector<Stretch> stretches;
  State now = State::unknown;
  int cpu = -1;
  auto since_ns = from_ns;
  bool seen = false;
  for (const auto& event : events_) {
    if (event.at_ns >= to_ns && seen) break;
    const auto change = change_of(event, thread, now);
    if (!change) continue;
    seen = true;
    if (event.at_ns > since_ns) {
      const auto until_ns = std::min(event.at_ns, to_ns);
      const bool inferred = now == State::unknown;
      stretches.push_back(
          {since_ns, until_ns, inferred ? change->before : now, inferred ? change->cpu : cpu});
      since_ns = until_ns;
    }
    if (event.at_ns >= to_ns) return stretches;
    now = change->after;
    cpu = change->cpu;
  }
  // A thread that is at anything but sleep is named at the beginning of each window.
  if (since_ns < to_ns) stretches.push_back({since_ns, to_ns, seen ? now : State::sleeps, cpu});
  return stretches;
}

std::optional<State> Timeline::state_at(std::int32_t thread, std::int64_t at_ns) const {
  const auto stretches = of(thread, at_ns, at_ns + 1);
  return stretches.empty() ? std::nullopt : std::optional(stretches.front().state);
}

std::vector<Held> Timeline::holders(int cpu, std::int64_t from_ns, std::int64_t to_ns) const {
  std::vector<Held> holders;
  std::optional<trace::Thread> now;
  auto since_ns = from_ns;
  for (const auto& event : events_) {
    if (event.kind != Kind::switched || event.cpu != cpu) continue;
    const auto until_ns = std::min(event.at_ns, to_ns);
    if (until_ns > since_ns) {
      holders.push_back({since_ns, until_ns, now.value_or(event.thread)});
      since_ns = until_ns;
    }
    now = event.other;
    if (event.at_ns >= to_ns) break;
  }
  if (since_ns < to_ns && now) holders.push_back({since_ns, to_ns, *now});
  return holders;
}

// Within one another they count once, as the outermost.
std::vector<Interrupted> Timeline::interrupts(int cpu, std::int64_t from_ns, std::int64_t to_ns) const {
  std::vector<Interrupted> all;
  int depth = 0;
  Interrupted now{};
  for (const auto& event : events_) {
    if (event.cpu != cpu) continue;
    if (begins(event.kind) && depth++ == 0)
      now = {event.at_ns, 0, event.kind == Kind::timer ? "timer interrupt" : event.what,
             event.kind == Kind::soft_interrupt};
    if (!ends(event.kind) || depth == 0 || --depth > 0) continue;
    now.from_ns = std::max(now.from_ns, from_ns);
    now.to_ns = std::min(event.at_ns, to_ns);
    if (now.to_ns > now.from_ns) all.push_back(now);
  }
  return all;
}

bool Timeline::lives(int cpu, std::int64_t from_ns, std::int64_t to_ns) const {
  return std::any_of(events_.begin(), events_.end(), [&](const Event& event) {
    return event.cpu == cpu && event.at_ns > from_ns && event.at_ns < to_ns;
  });
}

std::int32_t Timeline::priority_of(std::int32_t thread) const {
  auto priority = ordinary;
  for (const auto& event : events_) {
    if (event.kind == Kind::switched && event.other.id == thread) priority = event.other.priority;
    const bool says = event.kind == Kind::switched || event.kind == Kind::waking;
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

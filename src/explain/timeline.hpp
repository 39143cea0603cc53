// SPDX-License-Identifier: Apache-2.0
// The states of threads and CPUs over time, from the events of one machine.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "explain/scheduling.hpp"
#include "trace/trace.hpp"

namespace ontime::explain {

enum class State {
  unknown,
  sleeps,
  ready,
  comes,  // its CPU is idle: it runs or is about to, and only a later event shows it
  runs,
  stopped,  // by a signal
  traced,   // stopped for a tracer: a debugger, strace
  blocked,
  gone
};
inline bool has_cpu(State state) { return state == State::runs || state == State::comes; }

struct Stretch {
  std::int64_t from_ns, to_ns;
  State state;
  int cpu;  // on which it runs, or is to run; -1: not known
  std::int64_t length_ns() const { return to_ns - from_ns; }
};
// The thread that had a CPU; id 0: idle.
struct Held {
  std::int64_t from_ns, to_ns;
  trace::Thread thread;
  bool surely;  // false: State::comes
};
struct Interrupted {
  std::int64_t from_ns, to_ns;
  std::string what;
  bool soft;
};
// A thread, or an interrupt while that thread ran.
struct Waker {
  std::int32_t thread;
  std::string interrupt;  // "": none
};

class Timeline {
 public:
  // All times by a clock that is `later_ns` ahead of that of the events.
  Timeline(const trace::Window&, std::int64_t later_ns);

  const std::vector<trace::Event>& events() const { return events_; }
  std::vector<Stretch> of(std::int32_t thread, std::int64_t from_ns, std::int64_t to_ns) const;
  std::optional<State> state_at(std::int32_t thread, std::int64_t at_ns) const;
  std::vector<Held> holders(int cpu, std::int64_t from_ns, std::int64_t to_ns) const;
  std::vector<Interrupted> interrupts(int cpu, std::int64_t from_ns, std::int64_t to_ns) const;
  // When the thread freed memory for itself (direct reclaim).
  std::vector<Interrupted> reclaims(std::int32_t thread, std::int64_t from_ns, std::int64_t to_ns) const;
  // Whether that thread thawed a control group then.
  bool thawed(std::int32_t by, std::int64_t from_ns, std::int64_t to_ns) const;
  // The last switch on that CPU before that time; nullptr: none, or not traced.
  const trace::Event* last_switch(int cpu, std::int64_t at_ns) const;
  // The longest time within which nothing happened on it: all of that time, or less.
  std::int64_t silence_ns(int cpu, std::int64_t from_ns, std::int64_t to_ns) const;
  std::int64_t tick_ns() const { return tick_ns_; }  // the clock of a CPU that is busy interrupts it so often
  bool sees_timers() const { return sees_timers_; }  // its timers' interrupts are among the events
  // Which thread or interrupt ended its sleep or wait at `until_ns`; nullopt: unknown.
  std::optional<Waker> waker_of(std::int32_t thread, std::int64_t until_ns) const;
  // The kernel functions that it waited in; "": unknown.
  std::string waited_in(std::int32_t thread, std::int64_t until_ns) const;
  // As the last event states it; without one 120: SCHED_OTHER.
  std::int32_t priority_of(std::int32_t thread) const;
  std::string name_of(std::int32_t thread) const;

 private:
  void find_interrupts();
  const trace::Event* last_of_its_wait(trace::Kind, std::int32_t thread, std::int64_t until_ns) const;

  std::int64_t begin_ns_;
  std::vector<trace::Event> events_;
  std::int64_t tick_ns_;
  bool sees_timers_;
  std::vector<Scheduled> scheduling_;
  std::map<int, std::vector<Interrupted>> interrupts_;  // by CPU, in order
};

}  // namespace ontime::explain

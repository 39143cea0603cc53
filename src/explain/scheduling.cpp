// SPDX-License-Identifier: Apache-2.0
#include "explain/scheduling.hpp"

#include <algorithm>
#include <map>
#include <set>

namespace ontime::explain {
namespace {

using trace::Event;
using trace::Kind;
using trace::Thread;

constexpr std::int32_t idle = 0;

class Scheduling {
 public:
  explicit Scheduling(const std::vector<Event>& events) {
    for (const auto& event : events) enter(event);
    std::stable_sort(all.begin(), all.end(), [](const Scheduled& one, const Scheduled& other) {
      return one.event.at_ns < other.event.at_ns;
    });
  }
  std::vector<Scheduled> all;

 private:
  struct Cpu {
    Thread last;               // who came to it
    std::int64_t idle_ns = 0;  // when its idle thread last came, or did something there
  };

  void enter(const Event& event) {
    if (event.kind == Kind::waits) return;  // by who leaves, and just after it is said to have left
    const auto cpu = cpus_.find(event.cpu);
    if (cpu != cpus_.end() && cpu->second.last.id == idle) {
      const auto running = trace::running_at(event);
      if (running == idle)
        cpu->second.idle_ns = event.at_ns;
      else
        left_idle(cpu->second, event, running);
    }
    if (event.kind == Kind::switched) {
      cpus_[event.cpu] = {event.other, event.at_ns};
      threads_[event.thread.id] = {event.thread, event.at_ns};
      threads_[event.other.id] = {event.other, event.at_ns};
    }
    if (event.kind == Kind::waking) threads_[event.thread.id] = {event.thread, event.at_ns};
    if (event.kind == Kind::switched || event.kind == Kind::waking || event.kind == Kind::moved)
      all.push_back({event, event.at_ns});
  }

  void left_idle(Cpu& cpu, const Event& event, std::int32_t running) {
    auto came_ns = cpu.idle_ns;
    Thread thread{running, "", ordinary_priority};
    if (const auto known = threads_.find(running); known != threads_.end()) {
      thread = known->second.thread;
      came_ns = std::max(came_ns, known->second.at_ns);
    } else if (event.kind == Kind::switched) {
      thread = event.thread;
    }
    all.push_back({{.at_ns = came_ns,
                    .cpu = event.cpu,
                    .kind = Kind::switched,
                    .thread = cpu.last,
                    .other = thread,
                    .what = "R"},
                   event.at_ns});
    cpu.last = thread;
  }

  struct Known {
    Thread thread;
    std::int64_t at_ns;  // of the last that was said of it
  };
  std::map<std::int32_t, Cpu> cpus_;
  std::map<std::int32_t, Known> threads_;
};

}  // namespace

std::vector<Scheduled> scheduling_of(const std::vector<Event>& events, std::int64_t begin_ns) {
  auto all = Scheduling(events).all;
  std::set<std::int32_t> later;  // CPUs
  for (auto one = all.rbegin(); one != all.rend(); ++one)
    if (one->event.kind == Kind::switched && one->event.at_ns < begin_ns &&
        !later.insert(one->event.cpu).second)
      one->event.other = {nobody, "", ordinary_priority};
  return all;
}

}  // namespace ontime::explain

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
  Scheduling(const std::vector<Event>& events, std::int64_t begin_ns) : begin_ns_(begin_ns) {
    for (const auto& event : events) enter(event);
    std::ranges::stable_sort(all, {}, [](const Scheduled& one) { return one.event.at_ns; });
  }
  std::vector<Scheduled> all;

 private:
  struct Cpu {
    Thread running;
    std::int64_t seen_ns = 0;  // when that thread came, or its latest event there
  };

  void enter(const Event& event) {
    if (event.kind == Kind::waits) return;  // its thread has just left the CPU
    note_running(event);
    if (event.kind == Kind::switched) {
      cpus_[event.cpu] = {event.other, event.at_ns};
      threads_[event.thread.id] = {event.thread, event.at_ns};
      threads_[event.other.id] = {event.other, event.at_ns};
    }
    if (event.kind == Kind::waking) threads_[event.thread.id] = {event.thread, event.at_ns};
    if (event.kind == Kind::switched || event.kind == Kind::waking || event.kind == Kind::moved)
      all.push_back({event, event.at_ns});
  }

  // A thread with an event on a CPU runs there. If another thread was switched to last, a switch is missing.
  void note_running(const Event& event) {
    const auto running = trace::running_at(event);
    const auto cpu = cpus_.find(event.cpu);
    if (cpu == cpus_.end()) {
      if (event.at_ns >= begin_ns_) cpus_[event.cpu] = {known(running, event), event.at_ns};
      return;
    }
    if (cpu->second.running.id == running) {
      cpu->second.seen_ns = event.at_ns;
    } else if (cpu->second.running.id == idle || event.at_ns >= begin_ns_) {
      infer_switch(cpu->second, event, running);
    }
  }

  Thread known(std::int32_t running, const Event& event) const {
    if (const auto one = threads_.find(running); one != threads_.end()) return one->second.thread;
    return event.kind == Kind::switched ? event.thread : Thread{running, "", ordinary_priority};
  }

  // The state of the thread that left is unknown; the idle thread is always ready.
  void infer_switch(Cpu& cpu, const Event& event, std::int32_t running) {
    const auto thread = known(running, event);
    const auto latest = threads_.find(running);
    const auto came_ns = std::max(cpu.seen_ns, latest == threads_.end() ? cpu.seen_ns : latest->second.at_ns);
    all.push_back({{.at_ns = came_ns,
                    .cpu = event.cpu,
                    .kind = Kind::switched,
                    .thread = cpu.running,
                    .other = thread,
                    .what = cpu.running.id == idle ? "R" : ""},
                   event.at_ns});
    cpu = {thread, event.at_ns};
  }

  struct Known {
    Thread thread;
    std::int64_t at_ns;  // of its latest event
  };
  const std::int64_t begin_ns_;
  std::map<std::int32_t, Cpu> cpus_;
  std::map<std::int32_t, Known> threads_;
};

}  // namespace

std::vector<Scheduled> scheduling_of(const std::vector<Event>& events, std::int64_t begin_ns) {
  auto all = Scheduling(events, begin_ns).all;
  std::set<std::int32_t> later;  // CPUs
  for (auto one = all.rbegin(); one != all.rend(); ++one)
    if (one->event.kind == Kind::switched && one->event.at_ns < begin_ns &&
        !later.insert(one->event.cpu).second)
      one->event.other = {no_thread, "", ordinary_priority};
  return all;
}

}  // namespace ontime::explain

// SPDX-License-Identifier: Apache-2.0
#include "explain/threads.hpp"

#include <algorithm>
#include <map>
#include <optional>

namespace ontime::explain {
namespace {

using trace::Kind;

// Longer than a kernel without preemption delays a real-time thread (seen: 10.7 ms).
constexpr std::int64_t surely_throttled_ns = 20'000'000;
constexpr std::int64_t after_a_tick_ns = 1'000'000;  // the largest delay of a tick
// Longer than the exit latency of any idle state, and than the handling of interrupts that collected while a
// hypervisor paused the CPU.
constexpr std::int64_t slow_to_wake_ns = 1'000'000;
constexpr std::int64_t of_a_page_ns = 200'000;  // longer than the kernel computes to fetch one
const std::string sigstop = "19", sigtstp = "20";

bool brings_packets(const Timeline& timeline, const Waker& waker) {
  return waker.interrupt == "NET_RX" || is_kernels(timeline.name_of(waker.thread));
}

// A PREEMPT_RT kernel's thread that lets timers expire.
bool is_timers(const std::string& name) { return name.starts_with("ktimers/") || is_kernels(name); }

bool is_ordinary(const Held& held) { return held.thread.priority >= trace::least_ordinary; }

// Whether a real-time thread of this priority should have the CPU instead: less is more urgent.
bool is_outranked(const Held& held, std::int32_t priority) {
  return held.surely && held.thread.id != 0 && priority < trace::least_ordinary &&
         priority < held.thread.priority;
}

// Who sent the signal that stopped the thread: to itself, or to a thread of its process, which then wakes the
// others to stop. The kernel names one of the threads of the process that sent it. "": not seen.
std::string stopper_of(const Timeline& timeline, std::int32_t thread, std::int64_t before_ns) {
  std::map<std::int32_t, std::int32_t> senders;  // by the thread that is to stop
  std::string stopper;
  for (const auto& event : timeline.events()) {
    if (event.at_ns > before_ns) break;
    if (event.kind == Kind::signal && (event.what == sigstop || event.what == sigtstp))
      senders[event.thread.id] = event.other.id;
    if (event.thread.id != thread) continue;
    if (const auto to = senders.find(event.other.id); event.kind == Kind::waking && to != senders.end())
      senders[thread] = to->second;
    if (event.kind == Kind::switched && event.what == "T") {
      const auto by = senders.extract(thread);
      stopper = by.empty() ? "" : timeline.name_of(by.mapped());
    }
  }
  return stopper;
}

class Follower {
 public:
  Follower(Delay& delay, const Timeline& timeline, Part whose, std::int64_t from_ns, std::int64_t to_ns,
           bool has_cpu)
      : delay_(delay),
        timeline_(timeline),
        whose_(std::move(whose)),
        stretches_(timeline.of(whose_.thread_id, from_ns, to_ns)) {
    if (has_cpu && !stretches_.empty() && stretches_.front().state == State::comes)
      stretches_.front().state = State::runs;
  }

  void follow() {
    bool has_begun = false;
    for (std::size_t place = 0; place < stretches_.size(); ++place) {
      const auto& stretch = stretches_[place];
      if (fetches_pages(place)) {
        add(Cause::page_fault, stretch);
        continue;
      }
      switch (stretch.state) {
        case State::ready:
          waited_for_cpu(stretch, outranked(place));
          break;
        case State::runs:
          ran(stretch);
          break;
        case State::stopped:
          add(Cause::stopped, stretch, stopper_of(timeline_, whose_.thread_id, stretch.to_ns));
          break;
        case State::traced:
          add_woken(Cause::traced, stretch, timeline_.waker_of(whose_.thread_id, stretch.to_ns));
          break;
        case State::blocked:
          was_blocked(stretch);
          break;
        case State::sleeps:
          slept(stretch, has_begun);
          break;
        case State::comes:
        case State::gone:
        case State::unknown:
          break;
      }
      has_begun = has_begun || has_cpu(stretch.state);
    }
  }

 private:
  Part part_of(Cause cause, const std::string& culprit = "",
               const std::vector<std::int32_t>& culprit_threads = {}) const {
    auto part = whose_;
    part.cause = cause;
    part.culprit = culprit;
    part.culprit_threads = culprit_threads;
    return part;
  }

  void add(Cause cause, const Stretch& when, const std::string& culprit = "") {
    delay_.add(part_of(cause, culprit), when);
  }

  // Returns how long they took.
  std::int64_t add_interrupts(const Stretch& when) {
    std::int64_t ns = 0;
    for (const auto& interrupt : timeline_.interrupts(when.cpu, when.from_ns, when.to_ns)) {
      add(Cause::interrupts, {interrupt.from_ns, interrupt.to_ns, when.state, when.cpu}, interrupt.what);
      ns += interrupt.to_ns - interrupt.from_ns;
    }
    return ns;
  }

  static bool is_by_thread(const std::optional<Waker>& waker) {
    return waker && waker->interrupt.empty() && waker->thread != 0;
  }

  void add_woken(Cause cause, const Stretch& when, const std::optional<Waker>& waker) {
    if (is_by_thread(waker) && waker->thread != whose_.thread_id)
      delay_.add(part_of(cause, timeline_.name_of(waker->thread), {waker->thread}), when);
    else
      add(cause, when);
  }

  // If the thread that it waited for was itself delayed for most of the wait, that delay's cause counts.
  void add_waited_for(Cause cause, const Stretch& when, const std::optional<Waker>& waker) {
    if (!whose_.via.empty() || !is_by_thread(waker) || waker->thread == whose_.thread_id)
      return add_woken(cause, when, waker);
    auto whose = whose_;
    whose.via = timeline_.name_of(waker->thread);
    whose.thread_id = waker->thread;
    Delay of_holder;
    explain::follow(of_holder, timeline_, whose, when.from_ns, when.to_ns);
    auto left_ns = when.length_ns();
    for (auto& part : of_holder.parts) {
      const bool is_one =
          part.cause != Cause::waited && part.cause != Cause::unknown && 2 * part.ns >= when.length_ns();
      if (!is_one) continue;
      part.thread_id = whose_.thread_id;
      left_ns -= part.ns;
      delay_.add(part, part.ns, part.when);
    }
    delay_.add(part_of(cause, whose.via, {waker->thread}), left_ns, {when});
  }

  // A short run between two waits for pages belongs to the page faults: it is one cause.
  bool fetches_pages(std::size_t place) const {
    const auto waits_for_a_page = [&](const Stretch& stretch) {
      return stretch.state == State::blocked &&
             cause_of_wait(timeline_.waited_in(whose_.thread_id, stretch.to_ns)) == Cause::page_fault;
    };
    const auto is_beside = [](const Stretch& stretch) {
      return stretch.state != State::ready && !has_cpu(stretch.state);
    };
    const auto here = stretches_.begin() + static_cast<std::ptrdiff_t>(place);
    if (is_beside(*here)) return false;
    const auto after = std::find_if(here, stretches_.end(), is_beside);
    const auto before = std::find_if(std::make_reverse_iterator(here), stretches_.rend(), is_beside);
    if (before == stretches_.rend() || after == stretches_.end() || !waits_for_a_page(*before) ||
        !waits_for_a_page(*after))
      return false;
    std::int64_t between_ns = 0;
    for (auto one = before.base(); one != after; ++one) between_ns += one->length_ns();
    return between_ns <= of_a_page_ns;
  }

  // How long, in the whole wait, ordinary threads had the CPU of a real-time one (a thread that moves between
  // CPUs has several stretches of a wait). If the scheduler switched to an ordinary thread in that time, or
  // from another real-time thread to an ordinary one, real-time threads were throttled.
  struct Outranked {
    std::int64_t ns = 0;
    bool passed_over = false;
  };
  Outranked outranked(std::size_t place) const {
    const auto is_other = [](const Stretch& stretch) { return stretch.state != State::ready; };
    const auto here = stretches_.begin() + static_cast<std::ptrdiff_t>(place);
    auto one = std::find_if(std::make_reverse_iterator(here), stretches_.rend(), is_other).base();
    Outranked all;
    for (; one != stretches_.end() && !is_other(*one); ++one)
      for (const auto& held : timeline_.holders(one->cpu, one->from_ns, one->to_ns)) {
        if (!is_outranked(held, whose_.priority) || !is_ordinary(held)) continue;
        all.ns += held.to_ns - held.from_ns;
        const auto* const came = timeline_.last_switch(one->cpu, held.from_ns);
        all.passed_over =
            all.passed_over ||
            (came != nullptr &&
             (came->at_ns > one->from_ns + at_once_ns ||
              (came->what == "R" && came->thread.id != 0 && came->thread.priority < trace::least_ordinary)));
      }
    return all;
  }

  // Until when a ready thread was passed over: the last time that the scheduler let its CPU idle.
  static std::int64_t passed_over_until_ns(const std::vector<Held>& holders, const Stretch& stretch) {
    auto until_ns = stretch.from_ns;
    for (const auto& held : holders)
      if (held.thread.id == 0 && held.surely && held.from_ns > stretch.from_ns + at_once_ns &&
          held.to_ns - held.from_ns >= slow_to_wake_ns)
        until_ns = held.to_ns;
    return until_ns;
  }

  // It was ready: the cause depends on which thread had the CPU that it was to run on.
  void waited_for_cpu(const Stretch& stretch, const Outranked& outranked) {
    auto left_ns = stretch.length_ns();
    const auto holders = timeline_.holders(stretch.cpu, stretch.from_ns, stretch.to_ns);
    const auto passed_over_ns = passed_over_until_ns(holders, stretch);
    for (const auto& held : holders) {
      if (!held.surely) continue;
      left_ns -= held.to_ns - held.from_ns;
      if (held.thread.id == 0)
        waited_for_idle(stretch, held);
      else
        waited_for_thread(stretch.cpu, held, passed_over_ns, outranked);
    }
    delay_.add(part_of(Cause::unknown), left_ns, {});
  }

  // Whether the CPU ran, apart from its work on leaving idle.
  bool ran_at_all(int cpu, std::int64_t from_ns, std::int64_t to_ns) const {
    from_ns += at_once_ns;
    to_ns -= slow_to_wake_ns;
    return timeline_.silence_ns(cpu, from_ns, to_ns) < to_ns - from_ns;
  }

  void waited_for_idle(const Stretch& stretch, const Held& held) {
    const auto* const idled = timeline_.last_switch(stretch.cpu, held.from_ns);
    const bool is_put_off = idled != nullptr && idled->other.id == 0 && idled->thread.id != 0 &&
                            idled->what == "R";  // a thread that was ready itself
    const bool is_kept = is_put_off || ran_at_all(stretch.cpu, stretch.from_ns, stretch.to_ns);
    add(is_kept ? Cause::throttled : Cause::idle_cpu, {held.from_ns, held.to_ns, State::ready, stretch.cpu});
  }

  void waited_for_thread(int cpu, const Held& held, std::int64_t passed_over_ns, const Outranked& outranked) {
    const Stretch when{held.from_ns, held.to_ns, State::ready, cpu};
    const auto ns = when.length_ns() - add_interrupts(when);
    auto part = whose_;
    part.cause = why_behind(cpu, held, passed_over_ns, outranked);
    const bool ran = part.cause == Cause::not_preempted && ran_at_all(cpu, held.from_ns, held.to_ns);
    if (part.cause == Cause::cpu || ran) {
      part.culprit = held.thread.name.empty() ? timeline_.name_of(held.thread.id) : held.thread.name;
      part.culprit_threads = {held.thread.id};
      part.culprit_priority = held.thread.priority;
    }
    delay_.add(part, ns, {when});
  }

  // The tick interrupts a busy CPU, but not one that a hypervisor paused.
  Cause why_behind(int cpu, const Held& held, std::int64_t passed_over_ns, const Outranked& all) const {
    const bool outranked = is_outranked(held, whose_.priority);
    if (outranked &&
        timeline_.silence_ns(cpu, held.from_ns, held.to_ns) >= timeline_.tick_ns() + after_a_tick_ns)
      return Cause::idle_cpu;
    if (is_ordinary(held) && held.to_ns <= passed_over_ns) return Cause::throttled;
    if (!outranked) return Cause::cpu;
    const bool is_throttled = is_ordinary(held) && (all.passed_over || all.ns >= surely_throttled_ns);
    return is_throttled ? Cause::throttled : Cause::not_preempted;
  }

  void ran(const Stretch& stretch) {
    auto& spent = explain::add(delay_.ran, whose_, stretch);
    spent.ns -= add_interrupts({stretch.from_ns, stretch.to_ns, State::runs, stretch.cpu});
    for (const auto& one : timeline_.reclaims(whose_.thread_id, stretch.from_ns, stretch.to_ns)) {
      auto ns = one.to_ns - one.from_ns;  // an interrupt meanwhile is counted above
      for (const auto& interrupt : timeline_.interrupts(stretch.cpu, one.from_ns, one.to_ns))
        ns -= interrupt.to_ns - interrupt.from_ns;
      delay_.add(part_of(Cause::page_fault), ns, {{one.from_ns, one.to_ns, State::runs, stretch.cpu}});
      spent.ns -= ns;
    }
  }

  void was_blocked(const Stretch& stretch) {
    const auto cause = cause_of_wait(timeline_.waited_in(whose_.thread_id, stretch.to_ns));
    const auto waker = timeline_.waker_of(whose_.thread_id, stretch.to_ns);
    if (cause == Cause::lock)
      add_waited_for(cause, stretch, waker);
    else if (cause == Cause::frozen)
      add_woken(cause, stretch, waker);
    else
      add(cause, stretch);
  }

  // Sleep before it began with the message is no delay, unless another thread woke it instead of its timer.
  // Sleep of kernel threads, or sleep that a packet ended, only shows that there was nothing to do yet.
  void slept(const Stretch& stretch, bool has_begun) {
    const auto waker = timeline_.waker_of(whose_.thread_id, stretch.to_ns);
    const bool is_no_timer = whose_.stage == Stage::woke && timeline_.sees_timers() && is_by_thread(waker) &&
                             !is_timers(timeline_.name_of(waker->thread));
    if (!has_begun && !is_no_timer) {
      explain::add(delay_.slept, whose_, stretch);
      return;
    }
    if (is_kernels(whose_.thread) || (waker && brings_packets(timeline_, *waker))) return;
    if (is_by_thread(waker) && timeline_.thawed(waker->thread, stretch.from_ns, stretch.to_ns))
      add_woken(Cause::frozen, stretch, waker);
    else
      add_waited_for(Cause::waited, stretch, waker);
  }

  Delay& delay_;
  const Timeline& timeline_;
  const Part whose_;
  std::vector<Stretch> stretches_;
};

}  // namespace

bool is_interrupts(const std::string& name) { return name.starts_with("irq/"); }

bool is_kernels(const std::string& name) {
  return name.starts_with("ksoftirqd/") || name.starts_with("napi/") || is_interrupts(name);
}

void follow(Delay& delay, const Timeline& timeline, Part whose, std::int64_t from_ns, std::int64_t to_ns,
            bool has_cpu) {
  if (to_ns <= from_ns) return;
  whose.priority = timeline.priority_of(whose.thread_id);
  delay.last = whose;
  Follower(delay, timeline, std::move(whose), from_ns, to_ns, has_cpu).follow();
}

std::vector<Part> spent_by(std::int32_t thread, const Timeline& timeline, std::int64_t from_ns,
                           std::int64_t to_ns) {
  Delay delay;
  follow(delay, timeline, {.stage = Stage::delivered, .thread_id = thread}, from_ns, to_ns);
  for (const auto& [spent, cause] : {std::pair(&delay.ran, Cause::busy), {&delay.slept, Cause::waited}})
    for (auto& [whose, ns, when] : *spent) {
      whose.cause = cause;
      delay.add(whose, ns, when);
    }
  std::ranges::stable_sort(delay.parts, std::ranges::greater(), &Part::ns);
  return std::move(delay.parts);
}

}  // namespace ontime::explain

// SPDX-License-Identifier: Apache-2.0
#include "listen/why.hpp"

#include <algorithm>
#include <initializer_list>
#include <map>
#include <set>

#include <fmt/format.h>

#include "explain/explain.hpp"

namespace ontime::listen {
namespace {

using explain::Cause;
using explain::Part;
using explain::State;

constexpr std::int64_t longest_ns = 1'000'000'000;  // how far back it looks
constexpr std::size_t most_steps = 32;              // from thread to thread
// The kernel's priorities of SCHED_FIFO's and SCHED_RR's 99 … 1, and of the default's.
constexpr int real_time = 99, usual_priority = 50;

// The part of a late message's time to explain: its publisher's, or its way to the reader.
struct Leg {
  std::int64_t from_ns, to_ns;
  std::int32_t thread;       // that published, or took
  std::int64_t too_long_ns;  // how much longer it was than usual
  bool is_publishers;
};

Leg leg_of(const Miss& miss) {
  const auto& course = miss.course;
  const auto too_long_ns = miss.value_ns - course.usual_ns;
  const auto leg = [&](std::int64_t from_ns, std::int64_t to_ns, std::int32_t thread, bool is_publishers,
                       std::int64_t by_ns) {
    const auto begin_ns = std::max(from_ns, to_ns - longest_ns);
    return Leg{begin_ns, to_ns, thread, std::min(by_ns, to_ns - begin_ns), is_publishers};
  };
  const bool is_gap = miss.kind == Miss::Kind::gap;
  if (is_gap && course.before_ns != 0) {
    const auto by_ns = course.since_ns - course.before_ns - course.usual_ns;
    if (2 * by_ns >= too_long_ns)
      return leg(course.before_ns, course.since_ns, course.publisher, true, by_ns);
  }
  return leg(course.since_ns != 0 ? course.since_ns : course.taken_before_ns, course.taken_ns, course.taker,
             false, too_long_ns);
}

// A process chooses its name, and "; fix: " begins the advice.
std::string word_of(std::string name) {
  std::ranges::replace(name, ';', '?');
  return name;
}

struct Step {
  std::int32_t thread;
  std::int64_t from_ns, to_ns;
};

Why not_seen(const std::string& known, const std::string& alike = "") {
  const std::string prefix = "cause not seen: ";
  return {.cause = explain::word_of(Cause::unknown),
          .sentence = prefix + known,
          .alike = prefix + (alike.empty() ? known : alike)};
}

class Search {
 public:
  Search(const Miss& miss, const trace::Window& window, const OwnerOf& owner_of)
      : miss_(miss), owner_of_(owner_of), leg_(leg_of(miss)), timeline_(window, 0) {}

  Why why() {
    for (const auto& step : steps())
      for (auto& part : explain::spent_by(step.thread, timeline_, step.from_ns, step.to_ns))
        add(std::move(part));
    const auto most = std::ranges::max_element(parts_, {}, &Part::ns);
    const bool is_most = most != parts_.end() && is_seen(most->cause) && 2 * most->ns >= leg_.too_long_ns;
    if (is_most) return seen(*most);
    return by_several().value_or(unseen());
  }

 private:
  // The threads that had the message in hand, the last first: from a thread that slept to the one that woke
  // it.
  std::vector<Step> steps() const {
    std::vector<Step> steps;
    auto thread = leg_.thread;
    auto to_ns = leg_.to_ns;
    while (to_ns > leg_.from_ns && steps.size() < most_steps) {
      const auto stretches = timeline_.of(thread, leg_.from_ns, to_ns);
      const auto asleep = std::find_if(stretches.rbegin(), stretches.rend(), [](const auto& stretch) {
        return stretch.state == State::sleeps || stretch.state == State::unknown;
      });
      const auto from_ns = asleep == stretches.rend() ? leg_.from_ns : asleep->to_ns;
      if (from_ns < to_ns) steps.push_back({thread, from_ns, to_ns});
      const auto waker = asleep == stretches.rend() ? std::nullopt : timeline_.waker_of(thread, from_ns);
      to_ns = from_ns;
      if (waker && waker->thread != thread && has_it_in_hand(*waker)) {
        thread = waker->thread;
      } else {
        const auto other = asleep == stretches.rend() ? std::nullopt : held_up_receiver(thread, to_ns);
        if (!other) break;
        thread = *other;
      }
    }
    return steps;
  }

  // A thread of writer or reader, or a kernel thread that delivers packets. Over loopback the softirq
  // interrupts the sending thread.
  bool has_it_in_hand(const explain::Waker& waker) const {
    if (!waker.interrupt.empty() && waker.interrupt != "NET_RX") return false;
    if (explain::is_kernels(timeline_.name_of(waker.thread))) return true;
    const auto process = owner(waker.thread).process;
    if (process == 0) return false;
    return process == miss_.writer.process || (!leg_.is_publishers && process == miss_.reader.process);
  }

  // If its own timer woke the reader, another thread of its process received the message. Finds the one that
  // the writer woke and that still waited when the reader woke.
  std::optional<std::int32_t> held_up_receiver(std::int32_t reader, std::int64_t at_ns) const {
    if (leg_.is_publishers) return {};
    for (const auto& event : timeline_.events()) {
      if (event.at_ns >= at_ns) break;
      if (event.kind != trace::Kind::waking || event.thread.id == reader ||
          owner(event.thread.id).process != miss_.reader.process ||
          owner(event.other.id).process != miss_.writer.process || miss_.writer.process == 0)
        continue;
      const auto state = timeline_.state_at(event.thread.id, at_ns - 1);
      if (state && *state != State::sleeps && *state != State::unknown) return event.thread.id;
    }
    return {};
  }

  const Party& owner(std::int32_t thread) const {
    const auto [known, is_new] = owners_.try_emplace(thread);
    if (is_new) known->second = owner_of_(thread);
    return known->second;
  }

  // A cause that names another process, the machine, or long work. A sleep is not one: it may be intended.
  static bool is_seen(Cause cause) {
    return cause != Cause::waited && cause != Cause::timer && cause != Cause::unknown;
  }

  // The same culprit that delays several threads of a process is one cause.
  void add(Part part) {
    const auto same = std::find_if(parts_.begin(), parts_.end(), [&](const Part& one) {
      return one.cause == part.cause && one.culprit == part.culprit &&
             owner(one.thread_id) == owner(part.thread_id);
    });
    if (same == parts_.end())
      parts_.push_back(std::move(part));
    else
      same->ns += part.ns;
  }

  static std::string words_of(const Party& process, const std::string& thread, std::int32_t id,
                              bool with_number = true) {
    if (process.process == 0) return thread.empty() ? fmt::format("thread {}", id) : word_of(thread);
    const bool is_one_name = thread.empty() || thread == process.name;
    return word_of(process.name) + (with_number ? fmt::format(" [{}]", process.process) : "") +
           (is_one_name ? "" : fmt::format(" (thread {})", word_of(thread)));
  }

  static std::string policy_of(std::int32_t priority) {
    if (priority < 0) return "SCHED_DEADLINE";
    return priority < trace::least_ordinary ? fmt::format("real-time priority {}", real_time - priority)
                                            : "SCHED_OTHER";
  }

  // The comma that closes the victim's policy has nothing to close at the end of a sentence.
  static std::string said_of(const Part& part, const std::string& victim) {
    auto sentence = explain::sentence_of(part, victim);
    if (sentence.ends_with(',')) sentence.pop_back();
    return sentence;
  }

  // `alike`: the culprit without details, if it is no thread.
  Why seen(Part part, const std::string& alike = "") const {
    Why why{.is_seen = true,
            .cause = explain::word_of(part.cause),
            .victim = owner(part.thread_id),
            .thread = part.thread_id,
            .ns = part.ns};
    const auto victim =
        fmt::format("{}, {},", words_of(why.victim, timeline_.name_of(part.thread_id), part.thread_id),
                    policy_of(part.priority));
    auto without_details = part;
    if (!alike.empty()) without_details.culprit = alike;
    if (!part.culprit_threads.empty()) {
      const auto thread = part.culprit_threads.front();
      why.culprit = owner(thread);
      part.culprit = words_of(why.culprit, part.culprit, thread);
      without_details.culprit =
          words_of(why.culprit, without_details.culprit, thread, why.culprit == why.victim);
    }
    why.sentence = said_of(part, victim);
    why.alike = said_of(without_details, victim);
    if (!part.when.empty() && part.when.front().cpu >= 0 && part.cause != Cause::busy)
      why.cpu = part.when.front().cpu;
    why.fix = fix_of(part, why.victim);
    why.alike_fix = fix_of(without_details, why.victim);
    return why;
  }

  // A kernel thread that is bound to its CPU.
  static bool is_bound(const std::string& thread) {
    return std::ranges::any_of(
        std::initializer_list<const char*>{"kworker/", "ksoftirqd/", "migration/", "rcuc/", "ktimers/"},
        [&](const char* name) { return thread.starts_with(name); });
  }

  static std::string fix_of(const Part& part, const Party& process) {
    const auto victim = words_of(process, "", part.thread_id);
    const auto other_cpus = part.culprit_threads.empty() || is_bound(part.culprit)
                                ? std::string()
                                : fmt::format(", or other CPUs for {} (taskset)", part.culprit);
    switch (part.cause) {
      case Cause::cpu: {
        const bool is_below = part.culprit_priority < trace::least_ordinary;
        const auto priority = is_below ? real_time - part.culprit_priority + 1 : usual_priority;
        if (priority >= real_time) return fmt::format("a lower priority for {}{}", part.culprit, other_cpus);
        return fmt::format(
            "SCHED_FIFO for {} (chrt -a -f -p {} {}){}", victim, priority,
            process.process != 0 ? process.process : static_cast<std::uint32_t>(part.thread_id), other_cpus);
      }
      case Cause::interrupts:
        return fmt::format("keep interrupts off the CPU of {} (kernel.irq-cpus), or give it another CPU",
                           victim);
      case Cause::throttled:
        return "a larger quota for its cgroup (cpu.max), or kernel.rt-throttling: off; from Linux 6.12 on "
               "see fair-server in `ontime check`";
      case Cause::page_fault:
        return "lock its memory: mlockall() in the node";
      case Cause::busy:
        return "shorter callbacks, or a separate thread for this topic";
      default:
        return explain::advice_of(part, victim);
    }
  }

  // No single thread had the CPU for half of the delay, but all together did: then there is no culprit.
  std::optional<Why> by_several() const {
    std::int64_t all_ns = 0;
    const Part* most = nullptr;
    std::set<std::string> names;
    for (const auto& part : parts_) {
      if (part.cause != Cause::cpu) continue;
      all_ns += part.ns;
      names.insert(part.culprit);
      if (most == nullptr || part.ns > most->ns) most = &part;
    }
    if (most == nullptr || 2 * all_ns < leg_.too_long_ns) return {};
    auto whole = *most;
    whole.ns = all_ns;
    const auto others = fmt::format("others (longest: {})", word_of(most->culprit));
    whole.culprit = fmt::format("{} {}", names.size(), others);
    whole.culprit_threads.clear();
    return seen(whole, others);
  }

  // What is known without a cause.
  Why unseen() const {
    const auto& writer = miss_.writer;
    if (leg_.is_publishers)
      return not_seen(fmt::format("{} [{}] published it late, and no kernel event explains why",
                                  word_of(writer.name), writer.process));
    if (miss_.course.missing > 0)
      return not_seen(fmt::format("{} messages before it were published and not taken", miss_.course.missing),
                      "messages before it were published and not taken");
    if (writer.process == 0)
      return not_seen(
          "its writer is not recognized yet or runs on another machine, and its reader was not delayed");
    return not_seen("no kernel event explains the delay between writer and reader");
  }

  const Miss& miss_;
  const OwnerOf& owner_of_;
  const Leg leg_;
  const explain::Timeline timeline_;
  std::vector<Part> parts_;
  mutable std::map<std::int32_t, Party> owners_;  // by thread: each is looked up once
};

}  // namespace

std::vector<std::string> causes() {
  std::vector<std::string> words;
  for (int cause = 0; cause <= static_cast<int>(Cause::unknown); ++cause)
    words.emplace_back(explain::word_of(static_cast<Cause>(cause)));
  return words;
}

trace::Span span_of(const Miss& miss) {
  const auto leg = leg_of(miss);
  return {.message = 0, .from_ns = leg.from_ns, .to_ns = leg.to_ns};
}

Why why(const Miss& miss, const trace::Window& window, const OwnerOf& owner_of) {
  // A message hardly later than usual has no special cause.
  const auto usual_ns = miss.course.usual_ns;
  const bool is_gap = miss.kind == Miss::Kind::gap;
  if (usual_ns > 0 && 10 * (miss.value_ns - usual_ns) < miss.value_ns)
    return not_seen(
        fmt::format("this topic's messages {} {:.1f} ms {}", is_gap ? "usually come" : "are usually",
                    static_cast<double>(usual_ns) / 1e6, is_gap ? "apart" : "old"),
        fmt::format("this topic's messages {}", is_gap ? "usually come as late" : "are usually as old"));
  if (!window.whole) return not_seen("some kernel events of that time are missing");
  return Search(miss, window, owner_of).why();
}

}  // namespace ontime::listen

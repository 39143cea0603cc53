// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <map>
#include <optional>

#include <fmt/format.h>

#include "page/parts.hpp"
#include "report/explained.hpp"
#include "report/words.hpp"

namespace ontime::page {
namespace {

using explain::Cause;
using explain::Part;
using explain::Scene;
using explain::State;
using explain::Timeline;
using nlohmann::json;
using roundtrip::Fate;

constexpr std::size_t most_cpus = 6, most_threads = 12, most_packets = 24;
constexpr std::int64_t finest = 700;   // parts of what is shown: less cannot be seen
constexpr std::int64_t coarsest = 10;  // less shows nothing

enum class Look {
  other,
  ours,
  interrupt,
  soft_interrupt,
  several,
  ready,
  runs,
  stopped,
  blocked,
  queued,
  travels,
  dropped,
  sleeps
};

struct Bar {
  std::int64_t from_ns, to_ns;
  Look look;
  std::string name;
  bool culprit = false, together = false;
  std::int64_t length_ns() const { return to_ns - from_ns; }
};

// Stretches of time with a fast lookup: a culprit may come and go thousands of times.
class Moments {
 public:
  void add(std::int64_t from_ns, std::int64_t to_ns) { stretches_.emplace_back(from_ns, to_ns); }
  void end() {
    std::ranges::sort(stretches_);
    std::vector<std::pair<std::int64_t, std::int64_t>> apart;
    for (const auto& [from_ns, to_ns] : stretches_)
      if (!apart.empty() && from_ns <= apart.back().second)
        apart.back().second = std::max(apart.back().second, to_ns);
      else
        apart.emplace_back(from_ns, to_ns);
    stretches_ = std::move(apart);
  }
  bool any_within(std::int64_t from_ns, std::int64_t to_ns) const {
    const auto found =
        std::ranges::partition_point(stretches_, [&](const auto& one) { return one.second <= from_ns; });
    return found != stretches_.end() && found->first < to_ns;
  }

 private:
  std::vector<std::pair<std::int64_t, std::int64_t>> stretches_;
};

class Drawing {
 public:
  Drawing(const explain::Message& message, const Scene& scene, std::int64_t deadline_ns, std::int64_t parts)
      : message_(message), scene_(scene), deadline_ns_(deadline_ns), parts_(parts) {
    if (!message.parts.empty()) culprit_ = message.parts.front();
    for (const auto& when : culprit_.when) {
      at_work_[when.cpu].add(when.from_ns, when.to_ns);
      at_work_anywhere_.add(when.from_ns, when.to_ns);
    }
    for (auto& [cpu, moments] : at_work_) moments.end();
    at_work_anywhere_.end();
    find_span();
  }

  json all() {
    auto marks = json::array(), stages = json::array(), lanes = json::array();
    add_stages(stages);
    add_marks(marks);
    for (const auto* end : {"controller", "component"}) {
      add_threads(lanes, end);
      if (!scene_.one_machine) add_cpus(lanes, end);
      if (std::string_view(end) == "controller") add_packets(lanes);
    }
    if (scene_.one_machine) add_cpus(lanes, "controller");
    return {{"span_ns", to_ns_ - from_ns_},
            {"marks", marks},
            {"stages", stages},
            {"lanes", lanes},
            {"names", names_},
            {"one_machine", scene_.one_machine},
            {"uncertainty_ns", scene_.uncertainty_ns}};
  }

 private:
  const Timeline* timeline_of(const std::string& end) const {
    for (const auto& machine : scene_.machines)
      if (machine.end == end || scene_.one_machine) return &machine.timeline;
    return nullptr;
  }

  // From a little before it was due until a little after its answer, or where it ended.
  void find_span() {
    const auto due_ns = scene_.legs.front().from_ns;
    const bool is_dropped = culprit_.cause == Cause::dropped && !culprit_.when.empty();
    const auto end_ns =
        std::max(is_dropped ? culprit_.when.front().to_ns : scene_.legs.back().to_ns, due_ns + 1'000);
    const auto beside_ns = (end_ns - due_ns) / (is_dropped ? 4 : 16);
    from_ns_ = due_ns - beside_ns;
    to_ns_ = end_ns + beside_ns;
  }

  json after(std::int64_t ns) const { return std::clamp(ns, from_ns_, to_ns_) - from_ns_; }
  bool shown(std::int64_t ns) const { return from_ns_ <= ns && ns <= to_ns_; }

  std::size_t name(const std::string& text) {
    const auto shown = shortened(printable(text), 60);
    const auto [found, is_new] = places_.try_emplace(shown, names_.size());
    if (is_new) names_.push_back(shown);
    return found->second;
  }

  json packed(const std::vector<Bar>& bars) {
    auto all = json::array();
    for (const auto& bar : bars)
      all.push_back({after(bar.from_ns), after(bar.to_ns), static_cast<int>(bar.look), name(bar.name),
                     bar.culprit ? 1 : 0});
    return all;
  }

  void add_stages(json& stages) {
    for (const auto& leg : scene_.legs) {
      const bool is_last = &leg == &scene_.legs.back();
      const bool culprits = !culprit_.when.empty() && culprit_.when.front().from_ns >= leg.from_ns &&
                            (is_last || culprit_.when.front().from_ns < leg.to_ns);
      stages.push_back({leg.name, after(leg.from_ns), after(leg.to_ns), culprits ? 1 : 0});
    }
  }

  void add_marks(json& marks) {
    const auto& sample = message_.sample;
    const auto mark = [&](const char* what, std::int64_t ns) {
      if (shown(ns)) marks.push_back({what, after(ns)});
    };
    mark("due", scene_.legs.front().from_ns);
    mark("sent", sample.sent_ns);
    if (scene_.there_ns) mark("at server", *scene_.there_ns);
    if (scene_.answered_ns) mark("answered", *scene_.answered_ns);
    if (sample.fate != Fate::lost) mark("back", sample.received_ns);
    // The one that it missed.
    const auto since_ns = message_.late_by_response ? scene_.legs.front().from_ns : sample.sent_ns;
    if (deadline_ns_ > 0) mark("deadline", since_ns + deadline_ns_);
  }

  // Whether the culprit was at work then: on that CPU, or without a CPU anywhere.
  bool at_work(std::int64_t from_ns, std::int64_t to_ns, std::optional<int> cpu = {}) const {
    if (!cpu) return at_work_anywhere_.any_within(from_ns, to_ns);
    const auto there = at_work_.find(*cpu);
    return there != at_work_.end() && there->second.any_within(from_ns, to_ns);
  }

  void add_threads(json& lanes, const std::string& end) {
    const auto* timeline = timeline_of(end);
    if (timeline == nullptr) return;
    constexpr std::pair<State, Look> looks[] = {
        {State::ready, Look::ready},     {State::comes, Look::ready},     {State::runs, Look::runs},
        {State::stopped, Look::stopped}, {State::blocked, Look::blocked}, {State::sleeps, Look::sleeps}};
    std::size_t drawn = 0;
    for (const auto& thread : scene_.threads) {
      if (thread.end != end) continue;
      std::vector<Bar> bars;
      bool awake = false;
      if (drawn >= most_threads && thread.id != culprit_.thread_id) continue;
      for (const auto& stretch : timeline->of(thread.id, from_ns_, to_ns_))
        for (const auto& [state, look] : looks) {
          if (state != stretch.state) continue;
          const bool suffering = thread.end == culprit_.end && thread.id == culprit_.thread_id &&
                                 at_work(stretch.from_ns, stretch.to_ns);
          awake = awake || state != State::sleeps || suffering;
          if (state != State::sleeps || suffering)
            bars.push_back({stretch.from_ns, stretch.to_ns, look, word_of(state), suffering});
        }
      // A middleware has many threads: only those that were awake.
      if (!awake) continue;
      ++drawn;
      lanes.push_back(
          {{"of", "thread"}, {"end", end}, {"name", name(thread.role)}, {"bars", packed(merged(bars))}});
    }
  }

  const Scene::Thread* ours(const std::string& end, std::int32_t id) const {
    for (const auto& thread : scene_.threads)
      if (thread.id == id && (thread.end == end || scene_.one_machine)) return &thread;
    return nullptr;
  }

  // Whether this is the culprit, where and while it delayed a thread of ontime.
  bool accused(const std::string& name, std::initializer_list<Cause> of, int cpu, std::int64_t from_ns,
               std::int64_t to_ns) const {
    if (std::ranges::find(of, culprit_.cause) == of.end() || name != culprit_.culprit) return false;
    const bool anywhere = culprit_.cause == Cause::lock || culprit_.cause == Cause::waited;
    return at_work(from_ns, to_ns, anywhere ? std::nullopt : std::optional(cpu));
  }

  // The CPUs with the most to show: those of ontime's threads first, then those with many events.
  std::vector<int> cpus_of(const Timeline& timeline, const std::string& end) const {
    std::map<int, double> weight;
    for (const auto& thread : scene_.threads)
      if (thread.end == end || scene_.one_machine)
        for (const auto& stretch : timeline.of(thread.id, from_ns_, to_ns_))
          if (stretch.cpu >= 0 && stretch.state != State::sleeps)
            weight[stretch.cpu] += 2 + static_cast<double>(stretch.length_ns());
    for (const auto& event : timeline.events())
      if (shown(event.at_ns)) ++weight[event.cpu];
    std::vector<int> cpus;
    cpus.reserve(weight.size());
    for (const auto& [cpu, events] : weight) cpus.push_back(cpu);
    std::ranges::stable_sort(cpus, [&](int one, int other) { return weight[one] > weight[other]; });
    if (cpus.size() > most_cpus) cpus.resize(most_cpus);
    std::ranges::sort(cpus);
    return cpus;
  }

  void add_cpus(json& lanes, const std::string& end) {
    const auto* timeline = timeline_of(end);
    if (timeline == nullptr) return;
    const bool here = culprit_.end == end || scene_.one_machine;
    for (const auto cpu : cpus_of(*timeline, end)) {
      std::vector<Bar> bars;
      for (const auto& held : timeline->holders(cpu, from_ns_, to_ns_)) {
        if (held.thread.id == 0) continue;
        const auto* thread = ours(end, held.thread.id);
        const bool culprit = here && accused(held.thread.name, {Cause::cpu, Cause::lock, Cause::waited}, cpu,
                                             held.from_ns, held.to_ns);
        bars.push_back({held.from_ns, held.to_ns, thread != nullptr ? Look::ours : Look::other,
                        thread != nullptr ? (thread->end == "component" ? "pong " : "ping ") + thread->role
                                          : held.thread.name,
                        culprit});
      }
      auto interrupts = merged(interrupts_of(*timeline, cpu, here));
      bars = merged(bars);
      bars.insert(bars.end(), interrupts.begin(), interrupts.end());  // over the threads that they interrupt
      lanes.push_back(
          {{"of", "cpu"}, {"end", end}, {"name", name(fmt::format("CPU {}", cpu))}, {"bars", packed(bars)}});
    }
  }

  std::vector<Bar> interrupts_of(const Timeline& timeline, int cpu, bool here) const {
    std::vector<Bar> bars;
    for (const auto& interrupt : timeline.interrupts(cpu, from_ns_, to_ns_)) {
      const bool culprit =
          here && accused(interrupt.what, {Cause::interrupts}, cpu, interrupt.from_ns, interrupt.to_ns);
      bars.push_back({interrupt.from_ns, interrupt.to_ns,
                      interrupt.soft ? Look::soft_interrupt : Look::interrupt, interrupt.what, culprit});
    }
    return bars;
  }

  // Joins bars that are too short to be seen with their background topics.
  std::vector<Bar> merged(const std::vector<Bar>& bars) const {
    const auto least_ns = std::max<std::int64_t>((to_ns_ - from_ns_) / parts_, 1);
    std::vector<Bar> all;
    for (const auto& bar : bars) {
      const bool near = !all.empty() && bar.from_ns - all.back().to_ns < least_ns;
      if (near && bar.look == all.back().look && bar.name == all.back().name &&
          bar.culprit == all.back().culprit) {
        all.back().to_ns = bar.to_ns;
      } else if (near && bar.length_ns() < least_ns &&
                 (all.back().together || all.back().length_ns() < least_ns)) {
        auto& last = all.back();
        const bool ours = bar.look == Look::ours || bar.look == Look::runs;
        const bool were_ours = last.look == Look::ours || last.look == Look::runs;
        last.look = ours ? bar.look : were_ours ? last.look : Look::several;
        last.culprit = last.culprit || bar.culprit;
        last.name = last.culprit ? "several, including the culprit" : "several short ones";
        last.to_ns = bar.to_ns;
        last.together = true;
      } else {
        all.push_back(bar);
      }
    }
    return all;
  }

  // Packets that may be the message's: in the queue, on the wire, dropped.
  void add_packets(json& lanes) {
    for (const std::string end : {"controller", "component"}) {
      const auto* timeline = timeline_of(end);
      if (timeline == nullptr) continue;
      const auto its = [&](std::int32_t id) {
        const auto* thread = ours(end, id);
        return thread != nullptr && thread->end == end;
      };
      auto packets = explain::packets_of(*timeline, its, scene_.one_machine, from_ns_, to_ns_);
      if (packets.empty()) continue;
      if (packets.size() > most_packets) packets.resize(most_packets);
      std::vector<Bar> queued, travels, dropped;
      for (const auto& [given, leaves, comes, falls, queues] : packets) {
        const auto* ends = falls != nullptr ? falls : comes;
        for (const auto& queue : queues) {
          const auto* out = queue.out != nullptr ? queue.out : ends;
          queued.push_back({queue.in->at_ns, out != nullptr ? out->at_ns : to_ns_, Look::queued,
                            "in the queue of " + queue.in->what, begins(Cause::queue, queue.in->at_ns)});
        }
        if (leaves != nullptr && ends != nullptr)
          travels.push_back({leaves->at_ns, ends->at_ns, Look::travels, "on the wire of " + leaves->what});
        if (falls != nullptr)
          dropped.push_back({falls->at_ns, falls->at_ns, Look::dropped, "dropped: " + falls->what,
                             begins(Cause::dropped, falls->at_ns)});
      }
      for (const auto* over : {&travels, &dropped}) queued.insert(queued.end(), over->begin(), over->end());
      lanes.push_back({{"of", "packet"},
                       {"end", end},
                       {"name", name(end == "component" ? "pong sends" : "ping sends")},
                       {"bars", packed(queued)}});
    }
  }
  bool begins(Cause cause, std::int64_t at_ns) const {
    return culprit_.cause == cause && !culprit_.when.empty() && culprit_.when.front().from_ns == at_ns;
  }

  const explain::Message& message_;
  const Scene& scene_;
  const std::int64_t deadline_ns_, parts_;
  Part culprit_{};
  std::map<int, Moments> at_work_;  // the culprit, by CPU
  Moments at_work_anywhere_;
  std::int64_t from_ns_ = 0, to_ns_ = 0;
  std::vector<std::string> names_;
  std::map<std::string, std::size_t> places_;  // of names
};

}  // namespace

json drawing_of(const explain::Message& message, const Scene& scene, std::int64_t deadline_ns) {
  for (auto parts = finest; parts >= coarsest; parts /= 2)
    if (auto drawing = Drawing(message, scene, deadline_ns, parts).all();
        drawing.dump().size() <= most_of_a_drawing)
      return drawing;
  return nullptr;
}

}  // namespace ontime::page

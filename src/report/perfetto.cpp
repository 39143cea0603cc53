// SPDX-License-Identifier: Apache-2.0
// The trace event format ("JSON Trace Event Format", Google, 2016), which ui.perfetto.dev reads beside its
// own.
#include <algorithm>
#include <map>
#include <set>
#include <utility>

#include <fmt/format.h>

#include "report/explained.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

using explain::Message;
using explain::Scene;
using explain::State;
using nlohmann::ordered_json;
using roundtrip::Fate;
using trace::Kind;

// Its "processes", which are groups of tracks.
enum Group { messages = 1, controller_cpus, component_cpus, controller_threads, component_threads };
constexpr std::int64_t interrupts_track = 10'000;  // of CPU 0; beyond what has as many CPUs

std::string rank_of(std::int32_t priority) {
  if (priority < 0) return "SCHED_DEADLINE";
  if (priority < trace::least_ordinary)
    return fmt::format("real-time, priority {}", trace::least_ordinary - 1 - priority);
  return fmt::format("ordinary, nice {}", priority - 120);
}

class Trace {
 public:
  explicit Trace(std::int64_t deadline_ns) : deadline_ns_(deadline_ns) {}

  void add(const Message& message, const Scene& scene) {
    one_machine_ = scene.one_machine;
    uncertainty_ns_ = std::max(uncertainty_ns_, scene.uncertainty_ns);
    for (const auto& machine : scene.machines) add(machine, scene);
    add_way(message, scene);
  }

  // After text().
  ordered_json about() const {
    return {{"clock", "CLOCK_MONOTONIC of the controller's machine"},
            {"origin_ns", origin_ns()},
            {"machines",
             one_machine_ ? "both ends are on one" : "two; the component's times are moved to this clock"},
            {"clock_uncertainty_ns", uncertainty_ns_}};
  }

  // In order of time.
  std::string text() {
    std::ranges::stable_sort(events_, {}, &Event::first);
    std::string all;
    const auto append = [&](const ordered_json& event) {
      all += (all.empty() ? "" : ",\n") + event.dump(-1, ' ', true, ordered_json::error_handler_t::replace);
    };
    for (const auto& [track, name] : tracks_)
      append({{"ph", "M"},
              {"name", track.second < 0 ? "process_name" : "thread_name"},
              {"pid", track.first},
              {"tid", std::max<std::int64_t>(track.second, 0)},
              {"args", {{"name", printable(name)}}}});
    for (auto& [at_ns, event] : events_) {
      event["ts"] = static_cast<double>(at_ns - origin_ns()) / 1e3;
      append(event);
    }
    return all;
  }

 private:
  using Event = std::pair<std::int64_t, ordered_json>;
  std::int64_t origin_ns() const { return events_.empty() ? 0 : events_.front().first; }

  // Of one track one ends before the next begins.
  void slice(int group, std::int64_t track, std::int64_t from_ns, std::int64_t to_ns, const std::string& name,
             ordered_json about = nullptr) {
    ordered_json begin = {{"ph", "B"}, {"pid", group}, {"tid", track}, {"name", printable(name)}};
    auto end = begin;
    end["ph"] = "E";
    if (!about.is_null()) begin["args"] = std::move(about);
    events_.emplace_back(from_ns, std::move(begin));
    events_.emplace_back(to_ns, std::move(end));
  }
  // A point of an arrow: "s" its start, "t" on its way, "f" its end.
  void arrow(const char* phase, std::size_t id, int group, std::int64_t track, std::int64_t at_ns) {
    ordered_json event = {{"ph", phase},  {"cat", "packet"}, {"id", id},
                          {"pid", group}, {"tid", track},    {"name", "packet"}};
    if (*phase == 'f') event["bp"] = "e";  // of the slice around it, not of the next
    events_.emplace_back(at_ns, std::move(event));
  }
  void mark(int group, std::int64_t track, std::int64_t at_ns, const std::string& name,
            const char* scope = "t") {
    events_.emplace_back(
        at_ns,
        ordered_json{{"ph", "i"}, {"pid", group}, {"tid", track}, {"s", scope}, {"name", printable(name)}});
  }

  // Windows of messages that follow upon one another overlap: each moment is written once.
  void add(const Scene::Machine& machine, const Scene& scene) {
    auto& covered_ns = covered_.try_emplace(machine.end, machine.from_ns).first->second;
    const auto from_ns = std::max(covered_ns, machine.from_ns), to_ns = machine.to_ns;
    if (from_ns >= to_ns) return;
    covered_ns = to_ns;
    const bool of_component = machine.end == "component";
    const int cpus = of_component ? component_cpus : controller_cpus;
    tracks_[{cpus, -1}] = one_machine_ ? "the machine" : of_component ? "pong's machine" : "ping's machine";
    std::set<int> seen;
    for (const auto& event : machine.timeline.events()) seen.insert(event.cpu);
    for (const auto cpu : seen) {
      tracks_[{cpus, cpu}] = fmt::format("CPU {}", cpu);
      for (const auto& held : machine.timeline.holders(cpu, from_ns, to_ns))
        if (held.thread.id != 0)
          slice(cpus, cpu, held.from_ns, held.to_ns, held.thread.name,
                {{"thread", held.thread.id},
                 {"rank", rank_of(held.thread.priority)},
                 {"seen", held.surely ? "running" : "inferred from a later event"}});
      for (const auto& interrupt : machine.timeline.interrupts(cpu, from_ns, to_ns)) {
        tracks_[{cpus, interrupts_track + cpu}] = fmt::format("CPU {}, interrupts", cpu);
        slice(cpus, interrupts_track + cpu, interrupt.from_ns, interrupt.to_ns, interrupt.what,
              {{"soft", interrupt.soft}});
      }
    }
    for (const auto& event : machine.timeline.events())
      if (event.at_ns >= from_ns && event.at_ns < to_ns &&
          (event.kind == Kind::queued || event.kind == Kind::sent || event.kind == Kind::received ||
           event.kind == Kind::dropped))
        mark(cpus, event.cpu, event.at_ns,
             fmt::format("packet of {} bytes {}: {}", event.bytes, trace::word_of(event.kind), event.what));
    add_arrows(machine, scene, from_ns, to_ns);
    for (const auto& thread : scene.threads) {
      if (thread.end != machine.end && !one_machine_) continue;
      const int group = group_of(thread);
      tracks_[{group, -1}] = thread.end == "component" ? "pong's threads" : "ping's threads";
      tracks_[{group, thread.id}] = thread.role;
      for (const auto& stretch : machine.timeline.of(thread.id, from_ns, to_ns))
        if (stretch.state != State::sleeps && stretch.state != State::unknown)
          slice(group, thread.id, stretch.from_ns, stretch.to_ns, word_of(stretch.state),
                {{"cpu", stretch.cpu}});
    }
  }

  static int group_of(const Scene::Thread& thread) {
    return thread.end == "component" ? component_threads : controller_threads;
  }

  // Where both ends are on one machine a packet is the same at both: it is followed to the thread that it
  // woke.
  void add_arrows(const Scene::Machine& machine, const Scene& scene, std::int64_t from_ns,
                  std::int64_t to_ns) {
    const auto thread_of = [&](std::int32_t id) {
      return std::ranges::find_if(scene.threads, [&](const auto& thread) { return thread.id == id; });
    };
    const auto is_ours = [&](std::int32_t id) { return thread_of(id) != scene.threads.end(); };
    for (const auto& packet :
         explain::packets_of(machine.timeline, is_ours, scene.one_machine, from_ns, to_ns)) {
      if (packet.queued == nullptr || packet.received == nullptr) continue;
      const auto& events = machine.timeline.events();
      const auto woken = std::ranges::find_if(events, [&](const trace::Event& event) {
        return event.kind == Kind::waking && event.at_ns >= packet.received->at_ns &&
               event.cpu == packet.received->cpu && is_ours(event.thread.id);
      });
      if (woken == events.end() || woken->at_ns >= to_ns) continue;
      const auto id = ++arrows_;
      arrow("s", id, controller_cpus, packet.queued->cpu, packet.queued->at_ns);
      arrow("t", id, controller_cpus, packet.received->cpu, packet.received->at_ns);
      arrow("f", id, group_of(*thread_of(woken->thread.id)), woken->thread.id, woken->at_ns);
    }
  }

  // Of a message's track: what begins and ends within another comes after its begin and before its end.
  void phase(const char* phase, std::uint64_t index, const std::string& name, std::int64_t at_ns) {
    events_.emplace_back(at_ns, ordered_json{{"ph", phase},
                                             {"cat", "message"},
                                             {"id", index},
                                             {"pid", static_cast<int>(messages)},
                                             {"tid", 0},
                                             {"name", name}});
  }

  void add_way(const Message& message, const Scene& scene) {
    const auto& sample = message.sample;
    tracks_[{messages, -1}] = "messages";
    const auto end_ns = scene.legs.back().to_ns;
    const auto name = fmt::format("message {}", sample.index);
    const auto due_ns = scene.legs.front().from_ns;
    phase("b", sample.index, name, due_ns);
    for (const auto& leg : scene.legs) {
      phase("b", sample.index, leg.name, leg.from_ns);
      phase("e", sample.index, leg.name, leg.to_ns);
    }
    phase("e", sample.index, name, end_ns);
    mark(messages, 0, due_ns, fmt::format("message {} due", sample.index), "g");
    if (sample.fate == Fate::late && deadline_ns_ > 0)
      mark(messages, 0, sample.sent_ns + deadline_ns_, fmt::format("message {} late", sample.index), "g");
    if (!message.parts.empty())
      mark(messages, 0, end_ns,
           fmt::format("message {}: {}", sample.index, explain::sentence_of(message.parts.front())), "p");
  }

  const std::int64_t deadline_ns_;
  bool one_machine_ = true;
  std::int64_t uncertainty_ns_ = 0;
  std::map<std::pair<int, std::int64_t>, std::string> tracks_;  // -1: of the group itself
  std::map<std::string, std::int64_t> covered_;                 // by end, until when
  std::vector<Event> events_;
  std::size_t arrows_ = 0;
};

}  // namespace

std::string perfetto_of(const record::Reader& reader, const record::Run& run,
                        const std::vector<explain::Message>& messages, const explain::Pong* pong) {
  Trace trace(explain::deadline_ns_of(run));
  explain::each_scene(
      reader, run, messages, [&](const Message& message, const Scene& scene) { trace.add(message, scene); },
      pong);
  const auto events = trace.text();
  ordered_json about = trace.about();
  about.update({{"by", "ontime " ONTIME_VERSION},
                {"run", run.number},
                {"id", word(run.asked.id)},
                {"transport", word(run.asked.task.transport)}});
  return fmt::format("{{\"displayTimeUnit\":\"ns\",\"otherData\":{},\"traceEvents\":[\n{}\n]}}\n",
                     about.dump(-1, ' ', true, ordered_json::error_handler_t::replace), events);
}

}  // namespace ontime::report

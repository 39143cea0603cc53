// SPDX-License-Identifier: Apache-2.0
// Why messages were late or lost, from their recorded times and the kernels' trace. No thread is named as a
// culprit without an event that shows it; the rest is `unknown`. All parts of a delay add up to it.
// Ordinary thread only; throws record::Error.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "explain/causes.hpp"
#include "explain/packets.hpp"
#include "explain/timeline.hpp"
#include "record/record.hpp"
#include "roundtrip/sample.hpp"

namespace ontime::explain {

// The stages of a message. It passes `left` to `delivered` twice: on the request leg and on the reply leg.
enum class Stage { woke, sent, left, queued, travelled, delivered, answered };
const char* word_of(Stage);

struct Part {
  Cause cause = Cause::unknown;
  Stage stage = Stage::woke;
  std::string end{};     // "controller", "component": where
  std::string thread{};  // whose role: "send", "receive" …; "": none
  std::int32_t thread_id = 0;
  std::string via{};      // the thread that `thread` waited for, if the cause held up that one; else ""
  std::string culprit{};  // a thread's name, an interrupt, an interface, the kernel's reason; may be ""
  std::vector<std::int32_t> culprit_threads{};  // those of that name
  // The kernel's priorities (trace::Thread), of `thread` and of a culprit that is one.
  std::int32_t priority = 0, culprit_priority = 0;
  std::int64_t ns = 0;  // of the delay; where a message ended 0
  // Where in time, by the client's clock: what the thread, or the packet, was at. As long as `ns` at least;
  // empty where only the length is known.
  std::vector<Stretch> when{};
};

struct Message {
  roundtrip::Sample sample;
  std::int64_t delay_ns = 0;  // the sum of its parts; for a lost message: the examined time
  std::vector<Part> parts{};  // the largest first
  bool whole = true;          // false: the trace around it is incomplete
  // It met the deadline from when it was sent, but not from when it (or a skipped cycle before it) was due.
  bool late_by_response = false;
  bool is_fault() const { return sample.fate != roundtrip::Fate::on_time || late_by_response; }
};

// Messages with the same first culprit.
struct Group {
  Part culprit;  // without ns and when
  std::size_t messages = 0;
  std::size_t threads = 0;                 // of that name
  std::int64_t least_ns = 0, most_ns = 0;  // of the delay, by this culprit
  Remedy remedy{};
};

// Whether two parts are of one group: the same cause, thread and culprit.
bool same_cause(const Part&, const Part&);

struct Account {
  bool traced = false;                 // it was measured with `explain: on`
  std::uint64_t late = 0, lost = 0;    // of the run
  std::uint64_t late_by_response = 0;  // messages that are neither, but late from when they were due
  std::uint64_t after_skipped = 0;  // none of these, but late from when a skipped cycle before them was due
  std::vector<Message> messages;    // those examined, the worst first: lost, late, and the slowest others
  std::vector<Group> groups;        // of the faults, most messages first
  std::vector<std::string> limits;  // for people: what could not be examined, and why
};

std::int64_t deadline_ns_of(const record::Run&);  // 0: none

// The trace that `pong --explain` kept on the machine that answered a run by hand.
class Pong {
 public:
  // Throws record::Error if no kept trace matches that run, or all of them contradict it.
  Pong(const record::Reader& kept, const record::Reader&, const record::Run&);
  const record::Run& run() const { return run_; }
  // For a message sent at that time of pong's clock; nullptr: none was kept.
  const record::Trace* trace_of(const roundtrip::Sample&, std::int64_t sent_there_ns) const;

 private:
  record::Run run_;
  std::vector<record::Trace> traces_;
};

Account account_of(const record::Reader&, const record::Run&, const Pong* = nullptr);

// The trace around a message, for drawing; all times by the client's clock.
struct Scene {
  struct Machine {
    std::string end;  // "controller" if both ends are on one machine
    std::int64_t from_ns, to_ns;
    Timeline timeline;
  };
  struct Thread {
    std::string end, role;
    std::int32_t id;
  };
  // The message's stages as far as it came, with names for people.
  struct Leg {
    const char* name;
    std::int64_t from_ns, to_ns;
  };
  std::vector<Machine> machines;                      // those that were traced
  std::vector<Thread> threads;                        // of both ends
  std::vector<Leg> legs;                              // in order, each from where the one before it ended
  std::optional<std::int64_t> there_ns, answered_ns;  // when the server received and answered it
  std::int64_t uncertainty_ns = 0;                    // of the component's times
  bool one_machine = false;
};
// Calls the function for each of these messages of a run, in the order of their index.
void each_scene(const record::Reader&, const record::Run&, const std::vector<Message>&,
                const std::function<void(const Message&, const Scene&)>&, const Pong* = nullptr);

// Whether a kernel thread of that name receives packets.
bool is_kernels(const std::string& thread);
// What a thread of another program did in that time, by cause, the largest first: running is `busy`,
// sleeping is `waited`.
std::vector<Part> spent_by(std::int32_t thread, const Timeline&, std::int64_t from_ns, std::int64_t to_ns);
// As sentence_of(Part) below, with `whose` as the name of the thread.
std::string sentence_of(const Part&, const std::string& whose);
// For a person, without a scenario's settings; may be empty.
std::string advice_of(const Part&, const std::string& whose);

// For people, in one line: "pong's receive thread waited for a CPU while stress-ng-cpu ran".
std::string sentence_of(const Part&);
// The value that the run itself has for a setting of a remedy; "": not set.
std::string stated(const conditions::Run&, const std::string& key);
// Without settings that cannot help this thread or that the run already had.
Remedy remedy_for(const Part&, const record::Run&);
std::string text_of(const Remedy&);  // in one line

}  // namespace ontime::explain

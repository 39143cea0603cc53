// SPDX-License-Identifier: Apache-2.0
// What the kernel did around a message: its own tracepoints, in an instance of tracefs that is ours, kept for
// a few seconds and cut out on request. Ordinary threads only.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "journal/journal.hpp"

namespace ontime::trace {

struct Error : std::runtime_error {
  using std::runtime_error::runtime_error;
};

enum class Kind : std::uint8_t {
  switched,  // `thread` left the CPU for `other`; `what`: the state that it is in since
  waking,    // `thread` was woken by `other`; `what`: the number of the CPU that it is to run on
  interrupt,
  interrupt_end,
  soft_interrupt,
  soft_interrupt_end,
  timer,  // the timer's interrupt, where that is not one of the above
  timer_end,
  queued,    // a packet is given to an interface
  sent,      // a packet leaves the queue of an interface
  received,  // a packet has come over an interface
  dropped,   // a packet is dropped; `what`: the kernel's reason, else the function that dropped it, "":
             // neither is known
  signal,    // `thread` is sent one by `other`; `what`: its number
  waits,  // `thread` has left its CPU to wait in the kernel (state "D"); `what`: the kernel's functions that
          // it is in, the innermost first, "" where they are hidden
  moved,  // `thread` is to run on another CPU from now on; `what`: its number
  reclaim,  // `thread` needs memory, and begins to free some itself
  reclaim_end,
  freeze,  // `thread` freezes the control group `what` (version 2)
  thaw,
  no_route,     // what `thread` would send has no way to where it should go
  no_neighbour  // what `thread` sent waits until a host on the link claims the address
};
const char* word_of(Kind);
std::optional<Kind> kind_of(const std::string& word);

inline constexpr std::int32_t least_ordinary = 100;  // of the kernel's priorities

// A thread as an event names it.
struct Thread {
  std::int32_t id = 0;  // 0: the idle thread of a CPU
  std::string name{};   // "": the event does not say
  std::int32_t priority =
      0;  // the kernel's: below 0 SCHED_DEADLINE, 0 … 98 real-time 99 … 1, from least_ordinary on others
  bool operator==(const Thread&) const = default;
};

struct Event {
  std::int64_t at_ns = 0;  // CLOCK_MONOTONIC of the machine
  std::int32_t cpu = 0;
  Kind kind = Kind::switched;
  Thread thread{};     // whom it happened to; of interrupts and packets: who ran there
  Thread other{};      // by whom, or for whom
  std::string what{};  // the state ("R" ready, "S" sleeps, "D" waits in the kernel, "T" stopped …), the
                       // interrupt, the interface, the reason
  std::int32_t packet = 0;  // the same number is the same packet, within a window; 0: none
  std::int32_t bytes = 0;   // of the packet
  bool operator==(const Event&) const = default;
};
// Who had the CPU when it happened; of a switch: who left it.
std::int32_t running_at(const Event&);

// The time around a message.
struct Span {
  std::uint64_t message = 0;
  std::int64_t from_ns = 0, to_ns = 0;
};
// What was seen in it, in order of time, and nothing else: a kernel may not say how a CPU leaves its idle
// thread. Before `from_ns` there are those events that tell what the CPUs and the threads that do not sleep
// were at when it began.
struct Window {
  Span span;          // which ends early where there were more events than are kept
  bool whole = true;  // false: of a part of the span some, or all, is not known
  std::vector<Event> events;
};
// Times of events in JSON are after `from_ns`. from_json throws nlohmann::json::exception or Error.
nlohmann::json to_json(const Window&);
Window window_of(const nlohmann::json&);

// The kinds of change that a journal may have to undo.
std::span<const journal::Kind> kinds();

// What a recorder keeps at most.
struct Room {
  std::size_t bytes = std::size_t{96} << 20;  // of all events, the latest
  std::size_t events = 10'000;                // of a window, the first
};

// Records from its making to its destruction, and keeps the last seconds.
class Recorder {
 public:
  // Throws Error that says what this machine lacks, or journal::Error; nothing is changed then.
  explicit Recorder(journal::Journal&, Room = {});
  ~Recorder();
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;

  // For people: tracepoints that this kernel lacks, each with what is unknown without it.
  const std::vector<std::string>& missing() const;
  std::vector<Window> cut(std::vector<Span> spans);  // in order of time

 private:
  class Drain;
  std::unique_ptr<Drain> drain_;
};

}  // namespace ontime::trace

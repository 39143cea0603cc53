// SPDX-License-Identifier: Apache-2.0
// What is recorded of each counted message.
#pragma once

#include <cstdint>
#include <type_traits>

namespace ontime::roundtrip {

enum class Fate : std::uint8_t { on_time, late, lost };

// Times are CLOCK_MONOTONIC in ns, of the client unless said.
struct Sample {
  std::uint64_t index;       // from 0, in the order of sending
  std::int64_t intended_ns;  // when it should have been sent: the first cycle it was due in
  std::int64_t due_ns;       // the cycle it was sent in: intended_ns + skipped_cycles × period
  std::int64_t woke_ns;      // when the sending thread ran again (back-to-back: when the last answer came)
  // Of the cycles skipped before it: how long after such a cycle was due the sending thread at most ran
  // again, be it that it found the last message unanswered or that it slept through the cycle; 0: none.
  std::int64_t passed_wake_ns;
  std::int64_t sent_ns;             // just before the transport was called: the paper's T1
  std::int64_t received_ns;         // when its answer came: the paper's T2; 0 if lost
  std::int64_t server_received_ns;  // the server's clock; 0 if the server did not say
  std::int64_t server_sent_ns;      // the server's clock; 0 if the server did not say
  std::uint32_t skipped_cycles;     // cycles that passed unused before it
  Fate fate;
};
static_assert(std::is_trivially_copyable_v<Sample> && sizeof(Sample) == 80);

// When the first cycle was due that the sending thread should have been awake for, where it slept through all
// until this message's; else this one's own.
inline std::int64_t awaited_since_ns(const Sample& sample) {
  const bool slept =
      sample.skipped_cycles > 0 && sample.woke_ns - sample.passed_wake_ns <= sample.intended_ns;
  return slept ? sample.intended_ns : sample.due_ns;
}

// How late the sending thread ran for this message, with the cycles that it slept through before.
inline std::int64_t wake_up_latency_ns(const Sample& sample) {
  return sample.woke_ns - awaited_since_ns(sample);
}

// Whether the server gave both of its times, and its turnaround fits into the round trip. Any program may
// answer, so these bytes may hold anything.
inline bool has_server_times(const Sample& sample) {
  return sample.received_ns != 0 && sample.server_received_ns != 0 && sample.server_sent_ns != 0 &&
         sample.server_sent_ns >= sample.server_received_ns &&
         sample.server_sent_ns - sample.server_received_ns <= sample.received_ns - sample.sent_ns;
}

}  // namespace ontime::roundtrip

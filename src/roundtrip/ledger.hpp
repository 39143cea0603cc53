// SPDX-License-Identifier: Apache-2.0
// Judges each message: every message posted meets exactly one fate, and the sums add up at every moment.
//
// Two kinds of caller, neither of which ever waits for the other:
//   the owner      posts and settles. It is one thread at a time; ownership may pass on with a won arrived()
//   or
//                  expire(), which order memory as a lock would.
//   the receivers  report arrivals, from any number of threads.
// Real-time: all memory is there after construction.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>

#include <boost/lockfree/spsc_queue.hpp>

#include "message/message.hpp"
#include "roundtrip/roundtrip.hpp"

namespace ontime::roundtrip {

class Ledger {
 public:
  struct Size {
    std::size_t in_flight;  // rounded up to a power of two
    std::size_t samples;    // settled and not yet drained
  };
  Ledger(std::int64_t deadline_ns, std::int64_t timeout_ns, Size size);

  // Owner. When it should have been sent, …, when it is sent; see Sample.
  struct Posting {
    std::int64_t intended_ns, due_ns, woke_ns, sent_ns;
    std::uint32_t skipped_cycles;
  };
  bool full() const noexcept { return next_ - oldest_ > mask_; }
  bool idle() const noexcept { return next_ == oldest_; }
  std::uint64_t post(
      const Posting&) noexcept;  // to be called just before the message is sent; returns its index
  void refused() noexcept { count(refused_sends_); }

  // Receiver. True if this was the first answer to a message in flight.
  bool arrived(std::uint64_t index, std::int64_t at_ns, std::optional<message::ServerTimes> server) noexcept;
  void stray() noexcept { count(strays_); }

  // Any thread. True if the message was in flight beyond its time-out, and this call gave it up.
  bool expire(std::uint64_t index, std::int64_t now_ns) noexcept;

  // Owner. Judges, in order, all messages that are answered or beyond their time-out.
  void settle(std::int64_t now_ns) noexcept;

  Counters counters() const noexcept;             // any thread
  std::size_t drain(std::span<Sample>) noexcept;  // one ordinary thread

 private:
  enum class State : std::uint64_t { empty, in_flight, arriving, answered, lost, settled };
  struct Slot {
    // Index and state in one word, so that an arrival is matched and claimed in one step.
    std::atomic<std::uint64_t> word{word_of(~std::uint64_t{0} >> 3, State::empty)};
    std::atomic<std::int64_t> sent_ns{0};  // as in the sample; read by expire() in any thread
    Sample sample{};
  };
  static constexpr std::uint64_t word_of(std::uint64_t index, State state) noexcept {
    return index << 3 | static_cast<std::uint64_t>(state);
  }
  using Count = std::atomic<std::uint64_t>;
  static void count(Count& counter) noexcept { counter.fetch_add(1, std::memory_order_relaxed); }
  Slot& slot(std::uint64_t index) noexcept { return slots_[index & mask_]; }
  void judge(Sample&) noexcept;

  const std::int64_t deadline_ns_, timeout_ns_;
  const std::uint64_t mask_;
  std::unique_ptr<Slot[]> slots_;
  std::uint64_t next_ = 0, oldest_ = 0;  // the owner's
  std::atomic<std::uint64_t> highest_answered_{0};
  boost::lockfree::spsc_queue<Sample> samples_;
  Count sent_{0}, on_time_{0}, late_{0}, lost_{0}, duplicates_{0}, strays_{0}, reordered_{0},
      skipped_cycles_{0}, refused_sends_{0}, dropped_records_{0};
};

}  // namespace ontime::roundtrip

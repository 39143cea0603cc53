// SPDX-License-Identifier: Apache-2.0
// Judges each message: every message posted meets exactly one fate, and the sums add up at every moment.
//
// Two kinds of caller, neither of which ever waits for the other:
//   the owner      posts and settles. It is one thread at a time; ownership may pass on with a won arrived()
//                  or expire(), which order memory as a lock would.
//   the receivers  report arrivals, from any number of threads.
// The stamps judge, not the moment of looking: an answer that was there within the time-out, but reported
// only after the owner had given its message up, sets the record right, until the message's slot is used anew
// (`in_flight` messages later).
// Real-time: all memory is there after construction.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>

#include <boost/lockfree/spsc_queue.hpp>

#include "message/message.hpp"
#include "roundtrip/cycles.hpp"
#include "roundtrip/roundtrip.hpp"

namespace ontime::roundtrip {

class Ledger {
 public:
  struct Size {
    std::size_t in_flight;  // rounded up to a power of two
    std::size_t samples;    // settled and not yet drained
  };
  // What the deadline counts from: T1, or the cycle that the message was sent in.
  enum class From { sent, due };
  // `first`: the index of the first message.
  Ledger(std::int64_t deadline_ns, std::int64_t timeout_ns, Size size, From from = From::sent,
         std::uint64_t first = 0);

  // Owner. post() is called just before the message is sent, and returns its index; only after claim(),
  // which is false while there is no slot: all are in flight, or a receiver still writes into the next one.
  bool claim() noexcept;
  std::uint64_t post(const Turn&, std::int64_t sent_ns) noexcept;
  void refused() noexcept { count(refused_sends_); }
  bool idle() const noexcept { return next_ == oldest_; }

  // Receiver, with the index as a message has it: its lower 40 bits. True if this ended the wait for a
  // message in flight: its first answer, be it beyond the time-out. An answer from before the message was
  // sent is a stray: a peer may guess the next sequence number.
  bool arrived(std::uint64_t index, std::int64_t at_ns, std::optional<message::ServerTimes> server) noexcept;
  void stray() noexcept { count(strays_); }
  void wrong_size() noexcept { count(wrong_sizes_); }

  // Any thread. From when on a message that is in flight is beyond its time-out.
  std::int64_t lost_from_ns(std::uint64_t index) noexcept {
    return slot(index).sent_ns.load(std::memory_order_relaxed) + timeout_ns_ + 1;
  }
  // Any thread. True if the message was in flight beyond its time-out, and this call gave it up.
  bool expire(std::uint64_t index, std::int64_t now_ns) noexcept;

  // Owner. Judges, in order, all messages that are answered or beyond their time-out, and sets right those
  // that were given up too early.
  void settle(std::int64_t now_ns) noexcept;

  // Owner, once idle, after the last message.
  void close(const Rest&) noexcept;

  Counters counters() const noexcept;  // any thread
  // One ordinary thread. In order of index; one that was set right comes again, with its index, later.
  std::size_t drain(std::span<Sample>) noexcept;
  std::size_t undrained() const noexcept { return samples_.read_available(); }
  std::size_t capacity() const noexcept { return capacity_; }

 private:
  enum class State : std::uint64_t { empty, in_flight, arriving, answered, lost, settled };
  struct Answer {
    std::int64_t at_ns = 0;
    message::ServerTimes server{};
  };
  struct alignas(64) Slot {
    // Index, as a message has it, and state in one word, so that an arrival is matched and claimed in one
    // step.
    std::atomic<std::uint64_t> word{word_of(message::max_index, State::empty)};
    std::atomic<std::int64_t> sent_ns{0};  // as in the sample; read by receivers and by expire()
    Sample sample{};                       // the owner's
    Answer answer;                         // of the receiver that claimed it, and then the owner's
    Slot* next_belated = nullptr;          // the owner's
  };
  static constexpr std::uint64_t word_of(std::uint64_t index, State state) noexcept {
    return index << (64 - message::index_bits) | static_cast<std::uint64_t>(state);
  }
  static constexpr State state_of(std::uint64_t word) noexcept { return static_cast<State>(word & 7); }
  using Count = std::atomic<std::uint64_t>;
  static void count(Count& counter) noexcept { counter.fetch_add(1, std::memory_order_relaxed); }
  Slot& slot(std::uint64_t index) noexcept { return slots_[index & mask_]; }
  bool in_time(std::int64_t at_ns, std::int64_t sent_ns) const noexcept {
    return at_ns - sent_ns <= timeout_ns_;
  }
  void hand_in(Slot&) noexcept;
  void take_belated() noexcept;
  void judge(Slot&, bool answered) noexcept;

  const std::int64_t deadline_ns_, timeout_ns_;
  const From from_;
  const std::uint64_t mask_;
  const std::size_t capacity_;
  std::unique_ptr<Slot[]> slots_;
  std::uint64_t next_, oldest_;          // the owner's
  std::int64_t ended_ns_ = 0;            // the owner's: when the last message was answered, or given up
  std::atomic<Slot*> belated_{nullptr};  // answers in time to messages given up, for the owner
  std::atomic<std::uint64_t> highest_answered_;
  boost::lockfree::spsc_queue<Sample> samples_;
  Count sent_{0}, on_time_{0}, late_{0}, lost_{0}, duplicates_{0}, strays_{0}, reordered_{0}, wrong_sizes_{0},
      wrong_server_times_{0}, skipped_cycles_{0}, refused_sends_{0}, dropped_records_{0}, trailing_cycles_{0};
  std::atomic<std::int64_t> trailing_due_ns_{0}, trailing_until_ns_{0};
};

}  // namespace ontime::roundtrip

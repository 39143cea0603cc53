// SPDX-License-Identifier: Apache-2.0
#include "roundtrip/ledger.hpp"

#include <bit>

namespace ontime::roundtrip {

Ledger::Ledger(std::int64_t deadline_ns, std::int64_t timeout_ns, Size size)
    : deadline_ns_(deadline_ns),
      timeout_ns_(timeout_ns),
      mask_(std::bit_ceil(size.in_flight) - 1),
      slots_(std::make_unique<Slot[]>(mask_ + 1)),
      samples_(size.samples) {
  // Touched once from end to end, so that no page of it is new to the measuring thread.
  while (samples_.push(Sample{})) {
  }
  samples_.reset();
}

std::uint64_t Ledger::post(const Posting& posting) noexcept {
  const auto index = next_++;
  auto& entry = slot(index);
  entry.sample = {.index = index,
                  .intended_ns = posting.intended_ns,
                  .due_ns = posting.due_ns,
                  .woke_ns = posting.woke_ns,
                  .passed_wake_ns = 0,
                  .sent_ns = posting.sent_ns,
                  .received_ns = 0,
                  .server_received_ns = 0,
                  .server_sent_ns = 0,
                  .skipped_cycles = posting.skipped_cycles,
                  .fate = Fate::lost};
  entry.sent_ns.store(posting.sent_ns, std::memory_order_relaxed);
  entry.word.store(word_of(index, State::in_flight), std::memory_order_release);
  count(sent_);
  skipped_cycles_.fetch_add(posting.skipped_cycles, std::memory_order_relaxed);
  return index;
}

bool Ledger::arrived(std::uint64_t index, std::int64_t at_ns,
                     std::optional<message::ServerTimes> server) noexcept {
  auto& entry = slot(index);
  auto expected = word_of(index, State::in_flight);
  if (!entry.word.compare_exchange_strong(expected, word_of(index, State::arriving),
                                          std::memory_order_acq_rel)) {
    const bool answered_before = expected == word_of(index, State::arriving) ||
                                 expected == word_of(index, State::answered) ||
                                 expected == word_of(index, State::settled);
    count(answered_before ? duplicates_ : strays_);
    return false;
  }
  entry.sample.received_ns = at_ns;
  if (server) {
    entry.sample.server_received_ns = server->received_ns;
    entry.sample.server_sent_ns = server->sent_ns;
  }
  auto highest = highest_answered_.load(std::memory_order_relaxed);
  while (highest < index &&
         !highest_answered_.compare_exchange_weak(highest, index, std::memory_order_relaxed)) {
  }
  if (highest > index) count(reordered_);
  entry.word.store(word_of(index, State::answered), std::memory_order_release);
  return true;
}

bool Ledger::expire(std::uint64_t index, std::int64_t now_ns) noexcept {
  auto& entry = slot(index);
  auto expected = word_of(index, State::in_flight);
  if (entry.word.load(std::memory_order_acquire) != expected) return false;
  if (now_ns - entry.sent_ns.load(std::memory_order_relaxed) <= timeout_ns_) return false;
  return entry.word.compare_exchange_strong(expected, word_of(index, State::lost), std::memory_order_acq_rel);
}

void Ledger::settle(std::int64_t now_ns) noexcept {
  for (; oldest_ != next_; ++oldest_) {
    auto& entry = slot(oldest_);
    expire(oldest_, now_ns);
    const auto word = entry.word.load(std::memory_order_acquire);
    if (word != word_of(oldest_, State::answered) && word != word_of(oldest_, State::lost)) return;
    judge(entry.sample);
    // A lost message stays marked as lost, so that an answer that still comes is known for a stray.
    const auto state = entry.sample.fate == Fate::lost ? State::lost : State::settled;
    entry.word.store(word_of(oldest_, state), std::memory_order_release);
  }
}

void Ledger::judge(Sample& sample) noexcept {
  const auto round_trip_ns = sample.received_ns - sample.sent_ns;
  if (sample.received_ns != 0 && round_trip_ns > timeout_ns_) {
    // It came, but after its time-out, before anybody looked: the stamps judge, not the moment of looking.
    count(strays_);
    sample.received_ns = sample.server_received_ns = sample.server_sent_ns = 0;
  }
  if (sample.received_ns == 0) {
    sample.fate = Fate::lost;
    count(lost_);
  } else if (round_trip_ns > deadline_ns_) {
    sample.fate = Fate::late;
    count(late_);
  } else {
    sample.fate = Fate::on_time;
    count(on_time_);
  }
  if (!samples_.push(sample)) count(dropped_records_);
}

Counters Ledger::counters() const noexcept {
  const auto value = [](const Count& counter) { return counter.load(std::memory_order_relaxed); };
  Counters counters;
  // Fates before `sent`, so that the sum of fates never exceeds it while it runs.
  counters.on_time = value(on_time_);
  counters.late = value(late_);
  counters.lost = value(lost_);
  counters.sent = value(sent_);
  counters.duplicates = value(duplicates_);
  counters.strays = value(strays_);
  counters.reordered = value(reordered_);
  counters.skipped_cycles = value(skipped_cycles_);
  counters.refused_sends = value(refused_sends_);
  counters.dropped_records = value(dropped_records_);
  return counters;
}

std::size_t Ledger::drain(std::span<Sample> samples) noexcept {
  return samples_.pop(samples.data(), samples.size());
}

}  // namespace ontime::roundtrip

// SPDX-License-Identifier: Apache-2.0
#include "roundtrip/ledger.hpp"

#include <algorithm>
#include <bit>

namespace ontime::roundtrip {

namespace {

// Of indices that wrap around, as those of messages do.
bool is_before(std::uint64_t one, std::uint64_t other) noexcept {
  return static_cast<std::int64_t>((one - other) << (64 - message::index_bits)) < 0;
}

}  // namespace

Ledger::Ledger(std::int64_t deadline_ns, std::int64_t timeout_ns, Size size, From from, std::uint64_t first)
    : deadline_ns_(deadline_ns),
      timeout_ns_(timeout_ns),
      from_(from),
      mask_(std::bit_ceil(size.in_flight) - 1),
      capacity_(size.samples),
      slots_(std::make_unique<Slot[]>(mask_ + 1)),
      next_(first),
      oldest_(first),
      highest_answered_(first),
      samples_(size.samples) {
  // Touched once from end to end, so that no page of it is new to the measuring thread.
  while (samples_.push(Sample{})) {
  }
  samples_.reset();
}

bool Ledger::claim() noexcept {
  if (next_ - oldest_ > mask_) return false;
  auto& entry = slot(next_);
  auto word = entry.word.load(std::memory_order_acquire);
  if (state_of(word) == State::arriving) return false;
  // A lost message may still be answered, until here.
  return state_of(word) != State::lost ||
         entry.word.compare_exchange_strong(word, word_of(next_, State::empty), std::memory_order_acq_rel);
}

std::uint64_t Ledger::post(const Turn& turn, std::int64_t sent_ns) noexcept {
  const auto index = next_++;
  auto& entry = slot(index);
  entry.sample = {.index = index,
                  .intended_ns = turn.intended_ns,
                  .due_ns = turn.due_ns,
                  .woke_ns = turn.woke_ns,
                  .passed_wake_ns = turn.passed_wake_ns,
                  .sent_ns = sent_ns,
                  .received_ns = 0,
                  .server_received_ns = 0,
                  .server_sent_ns = 0,
                  .skipped_cycles = turn.skipped_cycles,
                  .fate = Fate::lost};
  entry.sent_ns.store(sent_ns, std::memory_order_relaxed);
  count(sent_);
  skipped_cycles_.fetch_add(turn.skipped_cycles, std::memory_order_relaxed);
  entry.word.store(word_of(index, State::in_flight), std::memory_order_release);
  return index;
}

bool Ledger::arrived(std::uint64_t index, std::int64_t at_ns,
                     std::optional<message::ServerTimes> server) noexcept {
  auto& entry = slot(index);
  auto found = entry.word.load(std::memory_order_acquire);
  const auto is = [&](State state) { return found == word_of(index, state); };
  const auto becomes = [&](State state) {
    return entry.word.compare_exchange_strong(found, word_of(index, state), std::memory_order_acq_rel);
  };
  const auto sent_ns = entry.sent_ns.load(std::memory_order_relaxed);
  if (at_ns < sent_ns) {
    stray();
    return false;
  }
  const bool counts = in_time(at_ns, sent_ns);
  const bool first = is(State::in_flight) && becomes(counts ? State::arriving : State::lost);
  const bool belated = !first && counts && is(State::lost) && becomes(State::arriving);
  if (!counts || (!first && !belated)) {
    const bool answered_before = is(State::arriving) || is(State::answered) || is(State::settled);
    count(answered_before ? duplicates_ : strays_);
    return first;  // if so, it came too late, but before the message was given up: now it is
  }
  entry.answer = {at_ns, server.value_or(message::ServerTimes{})};
  auto highest = highest_answered_.load(std::memory_order_relaxed);
  while (is_before(highest, index) &&
         !highest_answered_.compare_exchange_weak(highest, index, std::memory_order_relaxed)) {
  }
  if (is_before(index, highest)) count(reordered_);
  if (belated)
    hand_in(entry);
  else
    entry.word.store(word_of(index, State::answered), std::memory_order_release);
  return first;
}

void Ledger::hand_in(Slot& entry) noexcept {
  entry.next_belated = belated_.load(std::memory_order_relaxed);
  while (!belated_.compare_exchange_weak(entry.next_belated, &entry, std::memory_order_release,
                                         std::memory_order_relaxed)) {
  }
}

bool Ledger::expire(std::uint64_t index, std::int64_t now_ns) noexcept {
  auto& entry = slot(index);
  auto expected = word_of(index, State::in_flight);
  if (entry.word.load(std::memory_order_acquire) != expected) return false;
  if (in_time(now_ns, entry.sent_ns.load(std::memory_order_relaxed))) return false;
  return entry.word.compare_exchange_strong(expected, word_of(index, State::lost), std::memory_order_acq_rel);
}

void Ledger::settle(std::int64_t now_ns) noexcept {
  if (belated_.load(std::memory_order_relaxed) != nullptr) take_belated();
  for (; oldest_ != next_; ++oldest_) {
    auto& entry = slot(oldest_);
    expire(oldest_, now_ns);
    const auto word = entry.word.load(std::memory_order_acquire);
    if (word != word_of(oldest_, State::answered) && word != word_of(oldest_, State::lost)) return;
    judge(entry, word == word_of(oldest_, State::answered));
  }
}

void Ledger::take_belated() noexcept {
  Slot* next = nullptr;
  for (auto* entry = belated_.exchange(nullptr, std::memory_order_acquire); entry != nullptr; entry = next) {
    next = entry->next_belated;
    if (entry->sample.index >= oldest_) {  // given up, but not yet judged
      entry->word.store(word_of(entry->sample.index, State::answered), std::memory_order_release);
      continue;
    }
    lost_.fetch_sub(1, std::memory_order_release);  // before its other fate, so that it never has two
    judge(*entry, true);
  }
}

void Ledger::judge(Slot& entry, bool answered) noexcept {
  auto sample = entry.sample;
  if (answered) {
    sample.received_ns = entry.answer.at_ns;
    sample.server_received_ns = entry.answer.server.received_ns;
    sample.server_sent_ns = entry.answer.server.sent_ns;
    if (sample.server_sent_ns != 0 && !has_server_times(sample)) {
      count(wrong_server_times_);
      sample.server_received_ns = sample.server_sent_ns = 0;
    }
    entry.word.store(word_of(sample.index, State::settled), std::memory_order_release);
  }
  const auto judged_from_ns = from_ == From::due ? sample.due_ns : sample.sent_ns;
  const bool in_deadline = sample.received_ns - judged_from_ns <= deadline_ns_;
  sample.fate = !answered ? Fate::lost : in_deadline ? Fate::on_time : Fate::late;
  ended_ns_ = std::max(ended_ns_, answered ? sample.received_ns : sample.sent_ns + timeout_ns_);
  if (!samples_.push(sample)) count(dropped_records_);
  auto& fate = sample.fate == Fate::lost ? lost_ : sample.fate == Fate::late ? late_ : on_time_;
  fate.fetch_add(1, std::memory_order_release);
}

void Ledger::close(const Rest& rest) noexcept {
  const bool until_answered = rest.held || rest.cycles == 0;
  skipped_cycles_.fetch_add(rest.cycles, std::memory_order_relaxed);
  trailing_cycles_.store(rest.cycles, std::memory_order_relaxed);
  trailing_due_ns_.store(rest.due_ns, std::memory_order_relaxed);
  trailing_until_ns_.store(until_answered ? std::max(rest.woke_ns, ended_ns_) : rest.woke_ns,
                           std::memory_order_relaxed);
}

Counters Ledger::counters() const noexcept {
  const auto value = [](const auto& counter) { return counter.load(std::memory_order_relaxed); };
  Counters counters;
  // In the order opposite to that of counting: fates before `sent`, and what takes the place of a loss before
  // the loss, so that the sum of fates never exceeds `sent` while it runs.
  counters.on_time = on_time_.load(std::memory_order_acquire);
  counters.late = late_.load(std::memory_order_acquire);
  counters.lost = lost_.load(std::memory_order_acquire);
  counters.sent = value(sent_);
  counters.duplicates = value(duplicates_);
  counters.strays = value(strays_);
  counters.reordered = value(reordered_);
  counters.wrong_size = value(wrong_sizes_);
  counters.wrong_server_times = value(wrong_server_times_);
  counters.skipped_cycles = value(skipped_cycles_);
  counters.refused_sends = value(refused_sends_);
  counters.dropped_records = value(dropped_records_);
  counters.trailing_cycles = value(trailing_cycles_);
  counters.trailing_due_ns = value(trailing_due_ns_);
  counters.trailing_until_ns = value(trailing_until_ns_);
  return counters;
}

std::size_t Ledger::drain(std::span<Sample> samples) noexcept {
  return samples_.pop(samples.data(), samples.size());
}

}  // namespace ontime::roundtrip

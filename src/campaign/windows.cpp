// SPDX-License-Identifier: Apache-2.0
#include "campaign/windows.hpp"

#include <algorithm>

#include "message/message.hpp"

namespace ontime::campaign {
namespace {

using roundtrip::Fate;
using roundtrip::Sample;

constexpr std::array<std::size_t, 3> most{8, 32, 16};  // on time, late, lost
constexpr std::int64_t before_ns = 1'000'000;          // in which a thread was woken, or stopped
constexpr std::int64_t after_ns = 100'000;
constexpr std::int64_t longest_answer_ns = 1'000'000'000;
constexpr std::int64_t of_a_lost_one_ns = 200'000'000;  // after it was sent

trace::Span span_of(const Sample& sample) {
  const auto since_ns = awaited_since_ns(sample);
  const auto end_ns = sample.fate == Fate::lost ? sample.sent_ns + of_a_lost_one_ns
                                                : std::min(sample.received_ns, since_ns + longest_answer_ns);
  return {sample.index, since_ns - before_ns, end_ns + after_ns};
}

// The first that are lost are as bad as any later.
std::int64_t badness_of(const Sample& sample) {
  return sample.fate == Fate::lost ? 0 : sample.received_ns - awaited_since_ns(sample);
}

}  // namespace

Windows::Windows(Machines& machines, const Run& run, std::size_t number)
    : machines_(machines),
      component_(run.component),
      deadline_(run.task.client.deadline),
      first_message_(std::uint64_t{number} << message::index_bits) {}

void Windows::add(std::span<const Sample> samples) {
  for (const auto& sample : samples) clocks_.add(sample);
  for (const auto& sample : samples) choose(sample);
}

void Windows::choose(const Sample& sample) {
  forget(sample.index);  // recorded as lost, it was answered later
  const Chosen candidate{badness_of(sample), sample.index};
  const bool kept_waiting = sample.fate == Fate::on_time && candidate.badness_ns > deadline_.count();
  const auto fate = static_cast<std::size_t>(kept_waiting ? Fate::late : sample.fate);
  auto& chosen = chosen_[fate];
  if (chosen.size() == most[fate]) {
    const auto least = *chosen.begin();
    if (candidate.badness_ns <= least.badness_ns) return;
    forget(least.message);
  }
  chosen.insert(candidate);
  wanted_[sample.index] = span_of(sample);
}

void Windows::forget(std::uint64_t message) {
  for (auto& chosen : chosen_)
    std::erase_if(chosen, [&](const Chosen& one) { return one.message == message; });
  wanted_.erase(message);
  traces_.erase(message);
}

void Windows::order() {
  if (wanted_.empty() || awaited_ > 0) return;
  for (const auto& host : machines_.traced(component_)) {
    const bool by_its_own_clock = host != "controller";
    const auto difference_ns = by_its_own_clock ? clocks_.difference_ns() : 0;
    if (!difference_ns) continue;  // nothing was answered yet: the clock difference is unknown
    std::vector<trace::Span> spans;
    spans.reserve(wanted_.size());
    for (const auto& [message, span] : wanted_)
      spans.push_back({first_message_ + message, span.from_ns + *difference_ns, span.to_ns + *difference_ns});
    machines_.cut_out(host, spans);
    awaited_ += spans.size();
  }
  wanted_.clear();
}

std::size_t Windows::number_of(const trace::Window& window) {
  return window.span.message >> message::index_bits;
}

void Windows::take(const std::string& host, trace::Window window) {
  if (awaited_ > 0) --awaited_;
  window.span.message -= first_message_;
  const auto message = window.span.message;
  record::Trace trace{host == "controller" ? host : "component", std::move(window)};
  const bool chosen = std::ranges::any_of(chosen_, [&](const auto& of_fate) {
    return std::ranges::count(of_fate, message, &Chosen::message) > 0;
  });
  if (chosen) traces_.emplace(message, std::move(trace));
}

void Windows::write(record::Writer& writer, std::int64_t run) {
  for (const auto& [message, trace] : traces_) writer.trace(run, trace);
  traces_.clear();
}

}  // namespace ontime::campaign

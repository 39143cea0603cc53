// SPDX-License-Identifier: Apache-2.0
#include "explain/drift.hpp"

#include <algorithm>
#include <cstdlib>
#include <map>

#include "roundtrip/clocks.hpp"

namespace ontime::explain {
namespace {

constexpr std::int64_t stretch_ns = 100'000'000;  // the quickest answer of each such stretch is used
constexpr std::int64_t drift_in =
    10'000;  // 1 in as many: two oscillators, each 50 ppm from what it should be

}  // namespace

Drift::Beside Drift::Answer::at(std::int64_t then_ns) const {
  return {beside.difference_ns, beside.uncertainty_ns + std::abs(then_ns - sent_ns) / drift_in};
}

Drift::Drift(const record::Reader& reader, std::int64_t run) {
  std::map<std::int64_t, Answer> quickest;  // by stretch
  reader.each_sample(run, [&](const roundtrip::Sample& sample) {
    roundtrip::Clocks clocks;
    clocks.add(sample);
    if (!clocks.difference_ns()) return;
    const Answer answer{sample.sent_ns, {*clocks.difference_ns(), clocks.uncertainty_ns()}};
    auto& best = quickest.try_emplace(sample.sent_ns / stretch_ns, answer).first->second;
    if (answer.beside.uncertainty_ns < best.beside.uncertainty_ns) best = answer;
  });
  for (const auto& [stretch, answer] : quickest) moments_.push_back({answer.sent_ns, answer, answer});
  const auto take_if_better = [](Answer& one, const Answer& other, std::int64_t then_ns) {
    if (other.at(then_ns).uncertainty_ns < one.at(then_ns).uncertainty_ns) one = other;
  };
  for (std::size_t i = 1; i < moments_.size(); ++i)
    take_if_better(moments_[i].before, moments_[i - 1].before, moments_[i].sent_ns);
  for (std::size_t i = moments_.size(); i-- > 1;)
    take_if_better(moments_[i - 1].after, moments_[i].after, moments_[i - 1].sent_ns);
}

Drift::Beside Drift::at(std::int64_t sent_ns) const {
  if (moments_.empty()) return {};
  const auto next = std::partition_point(moments_.begin(), moments_.end(),
                                         [&](const Moment& moment) { return moment.sent_ns <= sent_ns; });
  if (next == moments_.begin()) return next->after.at(sent_ns);
  const auto before = std::prev(next)->before.at(sent_ns);
  if (next == moments_.end()) return before;
  const auto after = next->after.at(sent_ns);
  return after.uncertainty_ns < before.uncertainty_ns ? after : before;
}

}  // namespace ontime::explain

// SPDX-License-Identifier: Apache-2.0
#include "record/copy.hpp"

namespace ontime::record {

std::int64_t copy_run(const Reader& from, const Run& run, Writer& to) {
  constexpr std::size_t at_once = 4096;
  const auto number = to.begin_run(run.asked.document);
  std::vector<roundtrip::Sample> samples;
  samples.reserve(at_once);
  const auto hand_over = [&] {
    to.append(number, samples);
    samples.clear();
  };
  from.each_sample(run.number, [&](const roundtrip::Sample& sample) {
    samples.push_back(sample);
    if (samples.size() == at_once) hand_over();
  });
  hand_over();
  for (const auto& note : from.notes(run.number)) to.note(number, note);
  from.each_trace(run.number, [&](const Trace& trace) { to.trace(number, trace); });
  if (run.outcome.has_ended()) to.end_run(number, run.outcome.document);
  return number;
}

}  // namespace ontime::record

// SPDX-License-Identifier: Apache-2.0
#include <map>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "explain/explain.hpp"

namespace ontime::explain {

using roundtrip::Sample;

Pong::Pong(const record::Reader& kept, const record::Reader& reader, const record::Run& run) {
  struct Seen {
    trace::Span span;
    bool whole;
  };
  auto runs = kept.runs();
  std::vector<std::vector<Seen>> seen(runs.size());   // pong's traces of each run, without their events
  std::map<std::uint64_t, std::int64_t> received_ns;  // by message, of those that have one; 0: unknown
  for (std::size_t i = 0; i < runs.size(); ++i)
    kept.each_trace(runs[i].number, [&](const record::Trace& trace) {
      if (trace.host != "component") return;
      seen[i].push_back({trace.window.span, trace.window.whole});
      received_ns.try_emplace(trace.window.span.message, 0);
    });
  reader.each_sample(run.number, [&](const Sample& sample) {
    const auto at = received_ns.find(sample.index);
    if (at != received_ns.end() && sample.server_received_ns != 0) at->second = sample.server_received_ns;
  });
  std::size_t most = 0;
  for (std::size_t i = 0; i < runs.size(); ++i) {
    std::size_t fit = 0;
    bool is_anothers = false;
    for (const auto& [span, whole] : seen[i]) {
      const auto at_ns = received_ns.at(span.message);
      if (at_ns == 0) continue;
      const bool may_be_cut_off = !whole && span.to_ns < at_ns;
      const bool fits = span.from_ns <= at_ns && at_ns <= span.to_ns;
      fit += fits ? 1 : 0;
      is_anothers = is_anothers || (!fits && !may_be_cut_off);
    }
    if (is_anothers || fit <= most) continue;
    most = fit;
    run_ = std::move(runs[i]);
  }
  if (most == 0)
    throw record::WrongFile(fmt::format(
        "the --pong file has no trace of run {}: it is from another run. Fix: give the file that pong "
        "--explain --results wrote during that run",
        run.number));
  kept.each_trace(run_.number, [&](const record::Trace& trace) {
    if (trace.host == "component") traces_.push_back(trace);
  });
}

// The trace of the message itself; for a lost one, the trace of the time when it should have arrived.
const record::Trace* Pong::trace_of(const Sample& sample, std::int64_t sent_there_ns) const {
  const auto there_ns = sample.server_received_ns != 0 ? sample.server_received_ns : sent_there_ns;
  const record::Trace* best = nullptr;
  for (const auto& trace : traces_) {
    const auto& span = trace.window.span;
    if (there_ns < span.from_ns || span.to_ns < there_ns) continue;
    const bool is_its = span.message == sample.index;
    if (is_its || (best == nullptr && sample.server_received_ns == 0)) best = &trace;
    if (is_its) break;
  }
  return best;
}

}  // namespace ontime::explain

// SPDX-License-Identifier: Apache-2.0
#include "explain/loopback.hpp"

#include <algorithm>
#include <map>

namespace ontime::explain {
namespace {

using roundtrip::Sample;
using trace::Event;
using trace::Kind;

bool is_over_loopback(const Event& event, std::int64_t packet_bytes) {
  return event.kind == Kind::queued && event.what == "lo" && event.bytes >= packet_bytes;
}

}  // namespace

std::optional<End> end_over_loopback(const record::Reader& reader, const record::Run& run, const End& client,
                                     std::int64_t packet_bytes) {
  std::map<std::uint64_t, Sample> answered;
  reader.each_sample(run.number, [&](const Sample& sample) {
    if (sample.received_ns != 0 && sample.server_sent_ns != 0) answered[sample.index] = sample;
  });
  bool is_there = false;
  std::map<std::int32_t, int> times;  // that a thread sent when the server did
  reader.each_trace(run.number, [&](const record::Trace& trace) {
    const auto found = answered.find(trace.window.span.message);
    for (const auto& event : trace.window.events) {
      if (!is_over_loopback(event, packet_bytes)) continue;
      is_there = is_there || client.has(event.thread.id);
      if (found == answered.end() || client.has(event.thread.id)) continue;
      const auto& sample = found->second;
      times[event.thread.id] +=
          sample.server_sent_ns <= event.at_ns && event.at_ns <= sample.received_ns ? 1 : 0;
    }
  });
  const auto most = std::max_element(times.begin(), times.end(), [](const auto& one, const auto& other) {
    return one.second < other.second;
  });
  if (!is_there || most == times.end() || most->second == 0) return {};
  return End{.name = "component", .threads = {{most->first, "receive"}}, .interface = "lo"};
}

}  // namespace ontime::explain

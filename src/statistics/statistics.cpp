// SPDX-License-Identifier: Apache-2.0
#include "statistics/statistics.hpp"

#include <algorithm>
#include <numeric>

namespace ontime::statistics {

namespace {

// The smallest value that at least `share` of every `whole` sorted values do not exceed. In whole numbers:
// 0.999 as a double is not 0.999.
std::int64_t nearest_rank(const std::vector<std::int64_t>& sorted, std::size_t share, std::size_t whole) {
  const std::size_t rank = (sorted.size() * share + whole - 1) / whole;
  return sorted[rank - 1];
}

bool is_back_to_back(const nlohmann::json& asked) {
  return asked.contains("schedule") && asked.at("schedule") == "back-to-back";
}

}  // namespace

Distribution distribution(std::vector<std::int64_t>& values) {
  Distribution result;
  if (values.empty()) return result;
  std::sort(values.begin(), values.end());
  result.count = values.size();
  result.min = values.front();
  result.p50 = nearest_rank(values, 50, 100);
  result.p90 = nearest_rank(values, 90, 100);
  result.p99 = nearest_rank(values, 99, 100);
  result.p99_9 = nearest_rank(values, 999, 1000);
  result.p99_99 = nearest_rank(values, 9999, 10000);
  result.max = values.back();
  const auto sum = std::accumulate(values.begin(), values.end(), 0.0L);
  result.mean = static_cast<double>(sum / static_cast<long double>(values.size()));
  return result;
}

Summary summarise(const record::Reader& reader, const record::Run& run) {
  Summary summary{};
  summary.run = run;
  const bool has_cycles = !is_back_to_back(run.asked);
  std::vector<std::int64_t> round_trip, response, wake_up, server;
  reader.each_sample(run.number, [&](const roundtrip::Sample& sample) {
    ++summary.sent;
    summary.skipped_cycles += sample.skipped_cycles;
    if (has_cycles) wake_up.push_back(sample.woke_ns - sample.due_ns);
    if (sample.fate == roundtrip::Fate::lost) {
      ++summary.lost;
      return;
    }
    ++(sample.fate == roundtrip::Fate::late ? summary.late : summary.on_time);
    round_trip.push_back(sample.received_ns - sample.sent_ns);
    response.push_back(sample.received_ns - sample.intended_ns);
    if (sample.server_received_ns != 0 && sample.server_sent_ns != 0)
      server.push_back(sample.server_sent_ns - sample.server_received_ns);
  });
  summary.round_trip = distribution(round_trip);
  summary.response = distribution(response);
  summary.wake_up = distribution(wake_up);
  summary.server = distribution(server);
  return summary;
}

}  // namespace ontime::statistics

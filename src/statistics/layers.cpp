// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <set>

#include "statistics/statistics.hpp"

namespace ontime::statistics {
namespace {

using nlohmann::json;
using Value = std::function<std::optional<double>(const Summary&)>;

// A record may be from elsewhere: anything may be missing, or of another kind.
const json& member(const json& object, const char* key) {
  static const json none;
  const auto found = object.is_object() ? object.find(key) : object.end();
  return object.is_object() && found != object.end() ? *found : none;
}

std::string text(const Summary& summary, const char* key) {
  const auto& value = member(summary.run.asked, key);
  return value.is_string() ? value.get<std::string>() : "";
}

std::int64_t repetition(const Summary& summary) {
  const auto& value = member(summary.run.asked, "repetition");
  return value.is_number_integer() ? value.get<std::int64_t>() : 1;
}

std::optional<double> round_trip(const Summary& summary) {
  if (summary.round_trip.count == 0) return {};
  return static_cast<double>(summary.round_trip.p50);
}

// The sum over all threads on all hosts of what the record has under `key`, a message.
std::optional<double> a_message(const Summary& summary, const char* key) {
  double sum = 0;
  std::size_t threads = 0;
  for (const auto& host : member(summary.run.outcome, "hosts"))
    for (const auto& thread : member(host, "threads")) {
      const auto& value = member(thread, key);
      if (!value.is_number()) return {};
      sum += value.get<double>();
      ++threads;
    }
  if (threads == 0 || summary.sent == 0) return {};
  return sum / static_cast<double>(summary.sent);
}

using ByRepetition = std::map<std::int64_t, const Summary*>;

Cost cost(const ByRepetition& runs, const ByRepetition* below, const Value& value) {
  std::vector<double> totals, differences;
  for (const auto& [repetition, run] : runs) {
    const auto here = value(*run);
    if (!here) continue;
    totals.push_back(*here);
    if (below == nullptr || !below->contains(repetition)) continue;
    if (const auto there = value(*below->at(repetition))) differences.push_back(*here - *there);
  }
  return {estimate(totals), estimate(differences)};
}

}  // namespace

std::optional<Estimate> estimate(std::vector<double> values) {
  if (values.empty()) return {};
  std::sort(values.begin(), values.end());
  const auto n = values.size();
  Estimate result;
  result.count = n;
  result.median = n % 2 == 1 ? values[n / 2] : (values[n / 2 - 1] + values[n / 2]) / 2;
  // Between the k-th smallest and the k-th largest lies the median unless fewer than k values fell on one
  // side of it: confidence = 1 - 2 P(X < k), X ~ binomial(n, 1/2).
  double term = std::pow(0.5, static_cast<double>(n)), tail = term;
  std::size_t k = 1;
  for (; k < n / 2; ++k) {
    term *= static_cast<double>(n - k + 1) / static_cast<double>(k);
    if (1 - 2 * (tail + term) < 0.95) break;
    tail += term;
  }
  result.low = values[k - 1];
  result.high = values[n - k];
  result.confidence = std::max(0.0, 1 - 2 * tail);
  return result;
}

std::vector<Layer> layers(const std::vector<Summary>& summaries) {
  std::vector<std::string> order;
  std::map<std::string, ByRepetition> runs;
  std::set<std::string> below;
  for (const auto& summary : summaries) {
    const auto id = text(summary, "id");
    if (!runs.contains(id)) order.push_back(id);
    // Of a repetition that was made twice in one file, the newer counts.
    runs[id][repetition(summary)] = &summary;
    below.insert(text(summary, "adds_to"));
  }
  std::vector<Layer> result;
  for (const auto& id : order) {
    const auto& own = runs.at(id);
    const auto& first = *own.begin()->second;
    const auto adds_to = text(first, "adds_to");
    if (adds_to.empty() && !below.contains(id)) continue;
    const auto found = runs.find(adds_to);
    const auto* under = found == runs.end() ? nullptr : &found->second;
    result.push_back(
        {id, text(first, "transport"), adds_to, cost(own, under, round_trip),
         cost(own, under,
              [](const Summary& summary) -> std::optional<double> {
                const auto us = a_message(summary, "cpu_time_us");
                return us ? std::optional(*us * 1e3) : std::nullopt;
              }),
         cost(own, under, [](const Summary& summary) { return a_message(summary, "instructions"); })});
  }
  return result;
}

}  // namespace ontime::statistics

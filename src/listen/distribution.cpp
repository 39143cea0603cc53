// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <bit>
#include <cmath>
#include <numeric>

#include "listen/listen.hpp"

namespace ontime::listen {
namespace {

// 64 buckets for each power of two, one for each value below 128. A round time begins another one: its
// topic's periods are on both sides of it.
constexpr unsigned fine_bits = 6;

std::size_t bucket_of(std::int64_t ns) {
  const auto value = static_cast<std::uint64_t>(ns);
  const auto magnitude = static_cast<unsigned>(std::bit_width(value >> (fine_bits + 1U)));
  const auto round_times_below = std::ranges::lower_bound(round_times_ns, ns) - round_times_ns.begin();
  return (std::size_t{magnitude} << fine_bits) + static_cast<std::size_t>(value >> magnitude) +
         static_cast<std::size_t>(round_times_below);
}

// Two nodes may have the same name, and one of them may hang. So another process replaces a flow only if its
// process ended. A process may also end a publisher and begin another one. If the writer is not recognized,
// only the reader is known.
bool takes_its_place(const Flow& other, const Flow& flow) {
  const bool is_same = (flow.writer.process != 0 || flow.reader.process != 0) &&
                       other.writer == flow.writer && other.reader == flow.reader;
  return (flow.has_ended || is_same) && other.first_ns > flow.last_ns && !flow.topic.empty() &&
         other.topic == flow.topic && other.writer.name == flow.writer.name &&
         other.reader.name == flow.reader.name;
}

}  // namespace

void Distribution::add(std::int64_t ns) {
  const auto value = std::max<std::int64_t>(ns, 0);
  const auto bucket = bucket_of(value);
  if (bucket >= buckets_.size()) buckets_.resize(bucket + 1);
  ++buckets_[bucket].count;
  buckets_[bucket].sum += static_cast<double>(value);
  ++count_;
  max_ = std::max(max_, value);
  sum_ += static_cast<double>(value);
}

void Distribution::add(const Distribution& other) {
  buckets_.resize(std::max(buckets_.size(), other.buckets_.size()));
  for (std::size_t i = 0; i < other.buckets_.size(); ++i) {
    buckets_[i].count += other.buckets_[i].count;
    buckets_[i].sum += other.buckets_[i].sum;
  }
  count_ += other.count_;
  max_ = std::max(max_, other.max_);
  sum_ += other.sum_;
}

std::uint64_t Distribution::count_up_to(std::int64_t ns) const {
  if (ns < 0) return 0;
  if (ns >= max_) return count_;
  const auto end = std::min(bucket_of(ns) + 1, buckets_.size());
  return std::accumulate(buckets_.begin(), buckets_.begin() + static_cast<std::ptrdiff_t>(end),
                         std::uint64_t{0},
                         [](std::uint64_t sum, const Bucket& bucket) { return sum + bucket.count; });
}

// The values of a periodic topic share a bucket: its middle would be 0.3 % off at 10 ms.
std::int64_t Distribution::mean_ns(const Bucket& bucket) const {
  const auto mean = bucket.sum / static_cast<double>(bucket.count);
  return mean >= static_cast<double>(max_) ? max_ : static_cast<std::int64_t>(mean);
}

std::int64_t Distribution::quantile_ns(double portion) const {
  const auto rank = static_cast<std::uint64_t>(std::ceil(portion * static_cast<double>(count_)));
  if (rank >= count_) return max_;
  std::uint64_t below = 0;
  for (const auto& bucket : buckets_) {
    below += bucket.count;
    if (below >= std::max<std::uint64_t>(rank, 1)) return mean_ns(bucket);
  }
  return max_;
}

std::vector<std::pair<std::int64_t, std::uint64_t>> Distribution::values() const {
  std::vector<std::pair<std::int64_t, std::uint64_t>> values;
  for (const auto& bucket : buckets_)
    if (bucket.count > 0) values.emplace_back(mean_ns(bucket), bucket.count);
  if (!values.empty()) values.back().first = max_;
  return values;
}

std::optional<std::chrono::nanoseconds> Limits::longest_gap() const {
  const auto of_period = period ? std::optional(*period + *period / 2) : std::nullopt;
  return deadline && of_period ? std::min(deadline, of_period) : deadline ? deadline : of_period;
}

bool Limits::is_gap(std::int64_t ns) const {
  const auto longest = longest_gap();
  return longest && ns > longest->count();
}

bool Limits::is_silence(std::int64_t ns) const {
  // What the alert of prometheus/alerts.yml waits for.
  constexpr std::chrono::nanoseconds without_limit = std::chrono::seconds(5);
  return ns > longest_gap().value_or(without_limit).count();
}

bool Limits::is_too_old(std::int64_t ns) const { return age && ns > age->count(); }

void judge_silence(std::vector<Flow>& flows, const Limits& limits, std::int64_t until_ns,
                   std::int64_t since_ns) {
  for (auto& flow : flows) {
    const auto begun_ns = std::max(flow.last_ns, since_ns);
    flow.idle_ns = std::max<std::int64_t>(until_ns - begun_ns, 0);
    if (!limits.is_gap(until_ns - begun_ns)) continue;
    auto end_ns = until_ns;
    for (const auto& other : flows)
      if (takes_its_place(other, flow)) {
        end_ns = std::min(end_ns, other.first_ns);
        flow.was_replaced = true;
      }
    if (limits.is_gap(end_ns - begun_ns)) flow.silent_ns = end_ns - begun_ns;
  }
}

Findings::Forgotten Findings::all_forgotten() const {
  Forgotten all;
  for (const auto& [topic, one] : forgotten) {
    all.flows += one.flows;
    all.messages += one.messages;
    all.with_misses += one.with_misses;
  }
  return all;
}

double Flow::rate_hz() const {
  return period.sum_ns() <= 0 ? 0 : static_cast<double>(period.count()) * 1e9 / period.sum_ns();
}

std::string ros_name(const std::string& dds_topic) {
  return dds_topic.starts_with("rt/") ? dds_topic.substr(2) : dds_topic;
}

bool is_own_of_ros(const std::string& topic) {
  return topic == "ros_discovery_info" || topic == "/rosout" || topic == "/parameter_events" ||
         topic.starts_with("DCPS") || topic.starts_with("_fastdds_");
}

}  // namespace ontime::listen

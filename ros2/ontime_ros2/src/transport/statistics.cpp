// SPDX-License-Identifier: Apache-2.0
#include "statistics.hpp"

#include <algorithm>
#include <chrono>
#include <numeric>
#include <string>
#include <utility>

#include <pthread.h>

#include "message/message.hpp"

namespace ontime::transport::ros2 {
namespace {

using diagnostic_msgs::msg::DiagnosticStatus;
using diagnostic_msgs::msg::KeyValue;

constexpr std::uint64_t none = ~std::uint64_t{0};

KeyValue value(const std::string& key, const std::string& text) {
  KeyValue result;
  result.key = key;
  result.value = text;
  return result;
}

std::string microseconds(std::int64_t ns) {
  const std::string tenths = std::to_string(ns / 100 % 10);
  return std::to_string(ns / 1000) + "." + tenths;
}

void add_distribution(DiagnosticStatus& status, std::vector<std::int64_t>& sorted_ns) {
  std::sort(sorted_ns.begin(), sorted_ns.end());
  const auto count = static_cast<std::int64_t>(sorted_ns.size());
  const auto sum = std::accumulate(sorted_ns.begin(), sorted_ns.end(), std::int64_t{0});
  const auto rank = (99 * count + 99) / 100;  // the nearest one
  status.values.push_back(value("min_us", microseconds(sorted_ns.front())));
  status.values.push_back(value("mean_us", microseconds(sum / count)));
  status.values.push_back(value("p99_us", microseconds(sorted_ns[static_cast<std::size_t>(rank - 1)])));
  status.values.push_back(value("max_us", microseconds(sorted_ns.back())));
}

}  // namespace

Statistics::Statistics(rclcpp::Node& node, std::int64_t deadline_ns)
    : node_(node),
      deadline_ns_(deadline_ns),
      publisher_(node.create_publisher<diagnostic_msgs::msg::DiagnosticArray>("/diagnostics", 10)),
      thread_([this] {
        pthread_setname_np(pthread_self(), "ontime-live");
        publish_each_second();
      }) {}

Statistics::~Statistics() {
  {
    const std::lock_guard lock(mutex_);
    ended_ = true;
  }
  ending_.notify_one();
  thread_.join();
}

void Statistics::sent(std::uint64_t sequence, std::int64_t sent_ns) noexcept {
  InFlight& message = in_flight_[message::index_of(sequence) % in_flight_.size()];
  message.sent_ns.store(sent_ns, std::memory_order_relaxed);
  message.sequence.store(sequence, std::memory_order_release);
  sent_.fetch_add(1, std::memory_order_relaxed);
}

void Statistics::arrived(std::uint64_t sequence, std::int64_t arrival_ns) noexcept {
  InFlight& message = in_flight_[message::index_of(sequence) % in_flight_.size()];
  // Of a duplicate only the first counts, of another program's answer none.
  if (!message.sequence.compare_exchange_strong(sequence, none, std::memory_order_acquire)) return;
  round_trips_ns_.push(arrival_ns - message.sent_ns.load(std::memory_order_relaxed));
}

void Statistics::publish_each_second() {
  std::vector<std::int64_t> round_trips_ns;
  auto next = std::chrono::steady_clock::now();
  std::unique_lock lock(mutex_);
  while (!ending_.wait_until(lock, next += std::chrono::seconds(1), [this] { return ended_; })) {
    round_trips_ns.clear();
    round_trips_ns_.consume_all([&](std::int64_t ns) { round_trips_ns.push_back(ns); });
    publish(round_trips_ns);
  }
}

void Statistics::publish(std::vector<std::int64_t>& round_trips_ns) {
  const auto sent = sent_.exchange(0, std::memory_order_relaxed);
  if (sent == 0 && round_trips_ns.empty()) return;
  const auto late = std::count_if(round_trips_ns.begin(), round_trips_ns.end(),
                                  [this](std::int64_t ns) { return ns > deadline_ns_; });
  DiagnosticStatus status;
  status.name = "ontime: round trip";
  status.hardware_id = node_.get_fully_qualified_name();
  const bool bad = late > 0 || round_trips_ns.empty();
  status.level = bad ? DiagnosticStatus::WARN : DiagnosticStatus::OK;
  status.message = round_trips_ns.empty() ? "no answers" : late > 0 ? "late answers" : "on time";
  status.values = {value("sent", std::to_string(sent)),
                   value("answered", std::to_string(round_trips_ns.size())),
                   value("late", std::to_string(late))};
  if (!round_trips_ns.empty()) add_distribution(status, round_trips_ns);

  diagnostic_msgs::msg::DiagnosticArray array;
  array.header.stamp = node_.now();
  array.status.push_back(std::move(status));
  publisher_->publish(array);
}

}  // namespace ontime::transport::ros2

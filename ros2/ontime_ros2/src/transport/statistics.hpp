// SPDX-License-Identifier: Apache-2.0
// How the round trips are, each second, on /diagnostics while they are measured. What is recorded of a run
// comes from elsewhere; this is to look at.
#pragma once

#include <array>
#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <thread>
#include <vector>

#include <boost/lockfree/spsc_queue.hpp>
#include <diagnostic_msgs/msg/diagnostic_array.hpp>
#include <rclcpp/rclcpp.hpp>

namespace ontime::transport::ros2 {

class Statistics {
 public:
  Statistics(rclcpp::Node& node, std::int64_t deadline_ns);
  ~Statistics();
  Statistics(const Statistics&) = delete;
  Statistics& operator=(const Statistics&) = delete;

  // Real-time, and from two threads at once: one that sends, one at a time that receives.
  void sent(std::uint64_t sequence, std::int64_t sent_ns) noexcept;
  void arrived(std::uint64_t sequence, std::int64_t arrival_ns) noexcept;

 private:
  struct InFlight {
    std::atomic<std::uint64_t> sequence{~std::uint64_t{0}};
    std::atomic<std::int64_t> sent_ns{0};
  };

  void publish_each_second();
  void publish(std::vector<std::int64_t>& round_trips_ns);

  rclcpp::Node& node_;
  const std::int64_t deadline_ns_;
  std::array<InFlight, 4096> in_flight_;
  std::atomic<std::uint64_t> sent_{0};
  boost::lockfree::spsc_queue<std::int64_t, boost::lockfree::capacity<65536>> round_trips_ns_;
  rclcpp::Publisher<diagnostic_msgs::msg::DiagnosticArray>::SharedPtr publisher_;
  std::mutex mutex_;
  std::condition_variable ending_;
  bool ended_ = false;
  std::thread thread_;
};

}  // namespace ontime::transport::ros2

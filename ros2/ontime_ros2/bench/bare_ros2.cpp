// SPDX-License-Identifier: Apache-2.0
// A round trip by hand over rclcpp, as plain as a node can be: one subscription, one publisher, the
// single-threaded executor. RMW_IMPLEMENTATION, ROS_DOMAIN_ID and the middleware's own settings are the
// environment's.
//   bare_ros2 pong [reliable]
//   bare_ros2 ping PAYLOAD SECONDS [PERIOD_US] [reliable]     without a period: back to back
// Ping counts from the thousandth answer on (with a period: from the hundredth) and prints one line of JSON.
#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include <ontime_msgs/msg/round_trip.hpp>
#include <rclcpp/rclcpp.hpp>

#include "transport/clock.hpp"

namespace {

using namespace std::chrono_literals;
using ontime::transport::now_ns;
using ontime_msgs::msg::RoundTrip;

// What ontime's own node leaves out as well, for each of them is one more thing to wait for.
rclcpp::NodeOptions without_services() {
  return rclcpp::NodeOptions()
      .enable_rosout(false)
      .start_parameter_services(false)
      .start_parameter_event_publisher(false);
}

rclcpp::QoS qos(bool reliable) {
  rclcpp::QoS qos{rclcpp::KeepLast(1)};
  return reliable ? qos.reliable() : qos.best_effort();
}

class Pong final : public rclcpp::Node {
 public:
  explicit Pong(bool reliable)
      : Node("bare_pong", without_services()),
        publisher_(create_publisher<RoundTrip>("pong", qos(reliable))),
        subscription_(create_subscription<RoundTrip>(
            "ping", qos(reliable),
            [this](RoundTrip::ConstSharedPtr message) { publisher_->publish(*message); })) {}

 private:
  rclcpp::Publisher<RoundTrip>::SharedPtr publisher_;
  rclcpp::Subscription<RoundTrip>::SharedPtr subscription_;
};

struct Asked {
  std::size_t payload_bytes = 0;
  double seconds = 0;
  std::chrono::microseconds period{0};  // 0: back to back
  bool reliable = false;
};

class Ping final : public rclcpp::Node {
 public:
  explicit Ping(const Asked& asked)
      : Node("bare_ping", without_services()),
        asked_(asked),
        publisher_(create_publisher<RoundTrip>("ping", qos(asked.reliable))),
        subscription_(create_subscription<RoundTrip>(
            "pong", qos(asked.reliable), [this](RoundTrip::ConstSharedPtr message) { arrived(*message); })) {
    ping_.data.resize(asked.payload_bytes);
    round_trips_ns_.reserve(static_cast<std::size_t>(asked.seconds * (is_periodic() ? 10'000 : 100'000)) + 1);
    if (is_periodic()) timer_ = create_wall_timer(asked.period, [this] { send(); });
  }

  // Spins until the time is over. Returns how many answers were counted.
  std::size_t run() {
    const std::int64_t give_up_ns = now_ns() + 15'000'000'000;
    rclcpp::executors::SingleThreadedExecutor executor;
    executor.add_node(shared_from_this());
    std::int64_t now = now_ns();
    while (rclcpp::ok() && now < (end_ns_ == 0 ? give_up_ns : end_ns_)) {
      // Back to back it is the answer that sends the next one; here the first is sent, and after a loss.
      if (!is_periodic() && now - sent_ns_ >= 500'000'000) send();
      executor.spin_once(500ms);
      now = now_ns();
    }
    return round_trips_ns_.size();
  }

  void print() {
    std::sort(round_trips_ns_.begin(), round_trips_ns_.end());
    const auto us = [this](double share) {
      const auto rank = static_cast<std::size_t>(share * static_cast<double>(round_trips_ns_.size() - 1));
      return static_cast<double>(round_trips_ns_[rank]) / 1000;
    };
    std::printf(R"({"answered": %zu, "lost": %llu, "p50_us": %.3f, "p99_us": %.3f, "p99.9_us": %.3f, )"
                R"("max_us": %.3f})"
                "\n",
                round_trips_ns_.size(), static_cast<unsigned long long>(lost_), us(0.5), us(0.99), us(0.999),
                us(1));
  }

 private:
  bool is_periodic() const { return asked_.period.count() > 0; }

  void send() {
    if (end_ns_ != 0 && !answered_) ++lost_;
    answered_ = false;
    ++ping_.seq;
    sent_ns_ = now_ns();
    publisher_->publish(ping_);
  }

  void arrived(const RoundTrip& pong) {
    const std::int64_t arrival_ns = now_ns();
    if (pong.seq != ping_.seq || answered_) return;
    answered_ = true;
    if (++answers_ == (is_periodic() ? 100 : 1000))
      end_ns_ = arrival_ns + static_cast<std::int64_t>(asked_.seconds * 1e9);
    if (end_ns_ != 0) round_trips_ns_.push_back(arrival_ns - sent_ns_);
    if (!is_periodic()) send();
  }

  const Asked asked_;
  RoundTrip ping_;
  bool answered_ = true;
  std::int64_t sent_ns_ = 0;
  std::uint64_t lost_ = 0;
  std::uint64_t answers_ = 0;
  std::int64_t end_ns_ = 0;  // 0: still warming up
  std::vector<std::int64_t> round_trips_ns_;
  rclcpp::Publisher<RoundTrip>::SharedPtr publisher_;
  rclcpp::Subscription<RoundTrip>::SharedPtr subscription_;
  rclcpp::TimerBase::SharedPtr timer_;
};

int ping(const Asked& asked) {
  const auto node = std::make_shared<Ping>(asked);
  if (node->run() == 0) {
    std::fputs("no pong answered within 15 s\n", stderr);
    return 3;
  }
  node->print();
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  rclcpp::init(argc, argv);
  std::vector<std::string> arguments = rclcpp::remove_ros_arguments(argc, argv);
  Asked asked;
  asked.reliable = arguments.back() == "reliable";
  if (asked.reliable) arguments.pop_back();
  if (arguments.size() == 2 && arguments[1] == "pong") {
    rclcpp::spin(std::make_shared<Pong>(asked.reliable));
    rclcpp::shutdown();
    return 0;
  }
  if ((arguments.size() == 4 || arguments.size() == 5) && arguments[1] == "ping") {
    asked.payload_bytes = std::stoul(arguments[2]);
    asked.seconds = std::stod(arguments[3]);
    if (arguments.size() == 5) asked.period = std::chrono::microseconds(std::stoul(arguments[4]));
    const int status = ping(asked);
    rclcpp::shutdown();
    return status;
  }
  std::fputs("usage: bare_ros2 pong [reliable] | ping PAYLOAD SECONDS [PERIOD_US] [reliable]\n", stderr);
  return 2;
}

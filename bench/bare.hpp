// SPDX-License-Identifier: Apache-2.0
// Measures the round trips of both hand-written loops.
#pragma once

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <ctime>
#include <vector>

namespace bare {

inline std::int64_t now_ns() {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  return std::int64_t{now.tv_sec} * 1'000'000'000 + now.tv_nsec;
}

inline int failed(const char* what) {
  std::perror(what);
  return 3;
}

// Counts answers from the thousandth on, for this duration.
class RoundTrips {
 public:
  explicit RoundTrips(double seconds)
      : duration_ns_(static_cast<std::int64_t>(seconds * 1e9)), give_up_ns_(now_ns() + 10'000'000'000) {
    counted_ns_.reserve(static_cast<std::size_t>(seconds * 500'000));
  }

  void add(bool answered, std::int64_t sent_ns, std::int64_t received_ns) {
    last_ns_ = received_ns;
    if (!answered || ++answers_ < warm_up) return;
    if (answers_ == warm_up) end_ns_ = received_ns + duration_ns_;
    counted_ns_.push_back(received_ns - sent_ns);
  }

  bool done() const { return last_ns_ > (answers_ < warm_up ? give_up_ns_ : end_ns_); }

  // One line of JSON.
  int print() {
    if (counted_ns_.empty()) {
      std::fputs("timed out waiting 10 s for pong\n", stderr);
      return 3;
    }
    std::sort(counted_ns_.begin(), counted_ns_.end());
    std::printf(R"({"answered": %zu, "p50_us": %.3f, "p99_us": %.3f, "p99.9_us": %.3f, "max_us": %.3f})"
                "\n",
                counted_ns_.size(), us(500), us(990), us(999), us(1000));
    return 0;
  }

 private:
  // Nearest rank: the smallest value that so many thousandths of all values do not exceed.
  double us(std::size_t thousandths) const {
    const std::size_t rank = (counted_ns_.size() * thousandths + 999) / 1000;
    return static_cast<double>(counted_ns_[rank - 1]) / 1000;
  }

  static constexpr int warm_up = 1000;
  std::int64_t duration_ns_, give_up_ns_, end_ns_ = 0, last_ns_ = 0;
  std::int64_t answers_ = 0;
  std::vector<std::int64_t> counted_ns_;
};

}  // namespace bare

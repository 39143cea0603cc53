// SPDX-License-Identifier: Apache-2.0
// Sends a client's samples while it measures, and disturbs it as little as possible: its thread has a tenth
// of the weight of others and looks twice a second. With a period it sends the samples of each half second,
// so that a killed agent loses no more. Back-to-back, samples come as fast as possible and sending disturbs
// the measurement, so it sends only when the ring is half full. If ssh may use the link under test, samples
// wait in an unnamed file, as many as fit.
#pragma once

#include <condition_variable>
#include <cstdio>
#include <latch>
#include <memory>
#include <mutex>
#include <span>
#include <thread>
#include <vector>

#include "orders/orders.hpp"
#include "roundtrip/roundtrip.hpp"

namespace ontime::agent {

class Recorder {
 public:
  enum class Waiting { no, for_the_end };
  // Before the first counted message; returns once its thread has all the memory that it will need.
  Recorder(roundtrip::Client&, orders::Events&, roundtrip::Schedule, Waiting);
  ~Recorder();
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;

  // Hands the rest over; no more is recorded. Returns how many bytes of samples had waited.
  std::size_t finish();

 private:
  using File = std::unique_ptr<std::FILE, int (*)(std::FILE*)>;
  void record(const std::stop_token&);
  bool hand_over();  // a little of it; false if there was nothing
  bool keep(std::span<const std::uint8_t>);
  void hand_over_what_waited();

  roundtrip::Client& client_;
  orders::Events& events_;
  const std::size_t patience_;  // number of samples that may wait
  std::vector<roundtrip::Sample> batch_;
  File waiting_;  // null: samples do not wait, or no longer
  std::size_t waited_bytes_ = 0;
  std::mutex mutex_;
  std::condition_variable_any wake_;
  std::latch equipped_{1};
  std::jthread thread_;  // last: it uses the rest
};

}  // namespace ontime::agent

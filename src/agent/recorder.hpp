// SPDX-License-Identifier: Apache-2.0
// Hands a client's samples over while it measures, and is heard as little as can be: its thread weighs
// a tenth of others, looks twice a second, and sends nothing that may as well wait. A schedule with a
// period hands over what half a second brought, so that a killed agent takes no more with it; back-to-back,
// whose samples come as fast as they can and are felt by what they measure, only when the ring is half full.
#pragma once

#include <atomic>
#include <condition_variable>
#include <mutex>
#include <thread>
#include <vector>

#include "orders/orders.hpp"
#include "roundtrip/roundtrip.hpp"

namespace ontime::agent {

class Recorder {
 public:
  Recorder(roundtrip::Client&, orders::Events&, roundtrip::Schedule);
  ~Recorder();  // hands the rest over
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;

 private:
  void record();
  bool hand_over();  // a little of it; false if there was nothing

  roundtrip::Client& client_;
  orders::Events& events_;
  const std::size_t patience_;  // so many samples may wait
  std::vector<roundtrip::Sample> batch_;
  std::mutex mutex_;
  std::condition_variable wake_;
  std::atomic<bool> over_{false};
  std::thread thread_;
};

}  // namespace ontime::agent

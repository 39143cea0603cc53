// SPDX-License-Identifier: Apache-2.0
// Hands a client's samples over while it measures, and is heard as little as can be: its thread weighs
// a tenth of others, looks twice a second, and sends nothing that may as well wait. A schedule with a
// period hands over what half a second brought, so that a killed agent takes no more with it; back-to-back,
// whose samples come as fast as they can and are felt by what they measure, only when the ring is half full.
// Where they would go over the very link that is measured they wait in a file without a name, all of them
// that it has room for.
#pragma once

#include <atomic>
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
  void record();
  bool hand_over();  // a little of it; false if there was nothing
  bool keep(std::span<const std::uint8_t>);
  void hand_over_what_waited();

  roundtrip::Client& client_;
  orders::Events& events_;
  const std::size_t patience_;  // so many samples may wait
  std::vector<roundtrip::Sample> batch_;
  File waiting_;  // nothing: they do not wait, or no more
  std::size_t waited_bytes_ = 0;
  std::mutex mutex_;
  std::condition_variable wake_;
  std::atomic<bool> over_{false};
  std::latch equipped_{1};
  std::thread thread_;
};

}  // namespace ontime::agent

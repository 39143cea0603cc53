// SPDX-License-Identifier: Apache-2.0
// What tests of transports have messages arrive at.
#pragma once

#include <atomic>
#include <chrono>
#include <mutex>
#include <span>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "transport/clock.hpp"
#include "transport/transport.hpp"

namespace ontime::transport {

// Sends everything back, once it knows by whom.
class Echo final : public Sink {
 public:
  void arrived(std::uint64_t sequence, std::span<std::byte> payload, std::int64_t) noexcept override {
    ++arrivals;
    if (auto* to = endpoint.load()) to->send(sequence, payload);
  }
  std::atomic<Endpoint*> endpoint{nullptr};
  std::atomic<int> arrivals{0};
};

// Keeps the last.
class Keep : public Sink {
 public:
  void arrived(std::uint64_t sequence, std::span<std::byte> payload,
               std::int64_t arrival_ns) noexcept override {
    const std::lock_guard lock(mutex);
    last_sequence = sequence;
    last.assign(payload.begin(), payload.end());
    EXPECT_LE(arrival_ns, now_ns());
    ++arrivals;
  }
  std::mutex mutex;
  std::uint64_t last_sequence = 0;
  std::vector<std::byte> last;
  std::atomic<int> arrivals{0};
};

template <typename Done>
bool within(std::chrono::milliseconds time, Done done) {
  const auto end = std::chrono::steady_clock::now() + time;
  while (!done() && std::chrono::steady_clock::now() < end)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  return done();
}

}  // namespace ontime::transport

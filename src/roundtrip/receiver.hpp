// SPDX-License-Identifier: Apache-2.0
// Our thread that waits for arrivals with Receive::waitset. Receive::listener needs no such thread.
#pragma once

#include <atomic>
#include <thread>

#include <pthread.h>
#include <unistd.h>

#include "transport/transport.hpp"

namespace ontime::roundtrip {

class Receiver {
 public:
  Receiver(transport::Endpoint& endpoint, transport::Receive receive) : endpoint_(endpoint) {
    if (receive != transport::Receive::waitset) return;
    thread_ = std::thread([this] {
      pthread_setname_np(pthread_self(), name);
      tid_ = gettid();
      tid_.notify_one();
      while (!stopping_.load(std::memory_order_relaxed)) endpoint_.receive();
    });
    tid_.wait(0);
  }
  ~Receiver() {
    if (!thread_.joinable()) return;
    stopping_ = true;
    endpoint_.interrupt();
    thread_.join();
  }
  Receiver(const Receiver&) = delete;
  Receiver& operator=(const Receiver&) = delete;

  std::vector<transport::Thread> threads() const {
    if (tid_ == 0) return {};
    return {{tid_, "receive", name}};
  }

 private:
  static constexpr const char* name = "ontime-receive";
  transport::Endpoint& endpoint_;
  std::atomic<bool> stopping_{false};
  std::atomic<pid_t> tid_{0};
  std::thread thread_;
};

}  // namespace ontime::roundtrip

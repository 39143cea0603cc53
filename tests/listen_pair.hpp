// SPDX-License-Identifier: Apache-2.0
// One publisher and one reader, for tests of what is made of their messages.
#pragma once

#include <gtest/gtest.h>

#include "listen/messages.hpp"

namespace ontime::listen {

// A publisher in process 1 and a subscription in process 2, on one topic.
class OnePair : public testing::Test {
 protected:
  OnePair() : OnePair(Limits{}) {}
  explicit OnePair(const Limits& limits) : messages(limits) {
    messages.begin_process(1, "controller");
    messages.begin_process(2, "base");
    messages.name_topic(1, 0xa, "/cmd_vel");
    messages.name_topic(2, 0xb, "/cmd_vel");
  }

  void publish(std::int64_t at_ns, std::uint32_t process = 1, std::uint64_t endpoint = 0xa) {
    messages.add(
        {.kind = Observation::Kind::published, .at_ns = at_ns, .endpoint = endpoint, .process = process});
  }
  void take(std::int64_t at_ns, std::int64_t stamp_ns, bool after_loss = false) {
    messages.add({.kind = Observation::Kind::taken,
                  .after_loss = after_loss,
                  .at_ns = at_ns,
                  .stamp_ns = stamp_ns,
                  .endpoint = 0xb,
                  .process = 2,
                  .writer = {7}});
  }
  // Published and taken 50 µs later, stamped in between.
  void arrive(std::int64_t at_ns) {
    publish(at_ns);
    take(at_ns + 50'000, at_ns + 2'000);
  }
  void get_acquainted() {
    for (int i = -100; i < 10; ++i) arrive(at(i));  // longer than a second
  }
  static std::int64_t at(int i) { return 2'000'000'000 + std::int64_t{i} * 10'000'000; }
  Flow flow() const { return messages.findings().flows.at(0); }

  Messages messages;
};

}  // namespace ontime::listen

// SPDX-License-Identifier: Apache-2.0
// Messages on their way to Wire, 10 ms after each other.
#pragma once

#include <gtest/gtest.h>

#include "listen/wire.hpp"
#include "listen_rtps.hpp"

namespace ontime::listen {

class OnTheWire : public testing::Test {
 protected:
  OnTheWire() : OnTheWire(Limits{}) {}
  explicit OnTheWire(const Limits& limits) : wire(limits) {}
  void arrive(const Rtps& rtps, const std::string& destination = "10.0.0.2:7411", bool is_one_host = false,
              bool is_cut = false) {
    at_ns += 10'000'000;
    wire.add(at_ns, {.source = "10.0.0.1:4000",
                     .destination = destination,
                     .is_one_host = is_one_host,
                     .is_cut = is_cut,
                     .payload = rtps.bytes});
  }
  // As a capture that does not keep its last 50 bytes.
  void arrive_cut(Rtps rtps, const std::string& destination = "10.0.0.2:7411") {
    rtps.bytes.resize(rtps.bytes.size() - 50);
    arrive(rtps, destination, false, true);
  }
  Flow flow() const { return wire.findings().flows.at(0); }
  Wire wire;
  std::int64_t at_ns = 1'000'000'000'000;
};

}  // namespace ontime::listen

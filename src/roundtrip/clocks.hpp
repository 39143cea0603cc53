// SPDX-License-Identifier: Apache-2.0
// How the server's clock goes beside the client's, by the four times of the answer that was quickest on its
// way.
#pragma once

#include <cstdint>
#include <optional>

#include "roundtrip/sample.hpp"

namespace ontime::roundtrip {

class Clocks {
 public:
  void add(const Sample& sample) {
    if (!has_server_times(sample)) return;
    const auto most_ns = sample.server_received_ns - sample.sent_ns;
    const auto least_ns = sample.server_sent_ns - sample.received_ns;
    const auto uncertainty_ns = (most_ns - least_ns) / 2;
    if (difference_ns_ && uncertainty_ns >= uncertainty_ns_) return;
    difference_ns_ = least_ns + uncertainty_ns;
    uncertainty_ns_ = uncertainty_ns;
  }
  // What the server's clock shows when the client's shows 0. Nothing: no answer has said.
  std::optional<std::int64_t> difference_ns() const { return difference_ns_; }
  std::int64_t uncertainty_ns() const { return uncertainty_ns_; }  // either way

 private:
  std::optional<std::int64_t> difference_ns_;
  std::int64_t uncertainty_ns_ = 0;
};

}  // namespace ontime::roundtrip

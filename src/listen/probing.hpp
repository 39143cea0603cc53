// SPDX-License-Identifier: Apache-2.0
// When ontime set or removed probes. The kernel holds up threads whose code it changes: what was under way
// then is late by ontime, and is judged by no limit.
#pragma once

#include <cstdint>

namespace ontime::listen {

// CLOCK_MONOTONIC. Of times near to one another the whole is kept, of others the last: messages are judged
// soon after they came.
class Probing {
 public:
  void add(std::int64_t from_ns, std::int64_t to_ns) {
    constexpr std::int64_t near_ns = 100'000'000;
    if (from_ns - to_ns_ > near_ns) from_ns_ = from_ns;
    to_ns_ = to_ns;
  }
  bool overlaps(std::int64_t from_ns, std::int64_t to_ns) const {
    return from_ns_ <= to_ns && from_ns <= to_ns_;
  }

 private:
  std::int64_t from_ns_ = 0, to_ns_ = -1;
};

}  // namespace ontime::listen

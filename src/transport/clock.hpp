// SPDX-License-Identifier: Apache-2.0
// The clock that every time of a message is read from. Real-time safe.
#pragma once

#include <cstdint>
#include <ctime>

namespace ontime::transport {

inline std::int64_t now_ns() noexcept {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  return std::int64_t{now.tv_sec} * 1'000'000'000 + now.tv_nsec;
}

}  // namespace ontime::transport

// SPDX-License-Identifier: Apache-2.0
// Whether the server's times can be set beside the client's.
#pragma once

#include <optional>

#include "statistics/values.hpp"

namespace ontime::statistics {

class RoundTripParts {
 public:
  explicit RoundTripParts(const record::Outcome&);
  void message(const roundtrip::Sample&);  // an answered message with the server's times
  void into(Summary&) &&;

 private:
  struct Clocks {
    std::int64_t ahead_ns = 0;  // what the client's clock shows more than the server's
    std::int64_t error_ns = 0;  // of that
    std::int64_t moved_ns = 0;  // by which one was set meanwhile, if that is more than it may be off
    bool one = false;
  };
  static std::optional<Clocks> clocks_of(const record::Outcome&);
  std::optional<Clocks> clocks_;
  std::int64_t least_ns_ = 0;
  Values there_, back_;
};

}  // namespace ontime::statistics

// SPDX-License-Identifier: Apache-2.0
// The usual duration of each recorded stage of a run's messages, and the offset of the two ends' clocks.
#pragma once

#include <array>
#include <cstdint>

#include "explain/drift.hpp"
#include "record/record.hpp"
#include "roundtrip/sample.hpp"

namespace ontime::explain {

// due → woke → sent → received by the server → answered → received.
inline constexpr std::size_t legs = 5, senders_legs = 2;
struct Leg {
  std::int64_t from_ns, to_ns;
  std::int64_t length_ns() const { return to_ns - from_ns; }
};

class Usual {
 public:
  // Medians of the messages on time, or of all answered ones if none was on time: if most are late, the delay
  // does not count as usual. `one_clock`: both ends have the same clock.
  Usual(const record::Reader&, std::int64_t run, bool one_clock);
  std::int64_t leg_ns(std::size_t leg) const { return medians_[leg]; }
  bool is_of_on_time() const { return is_of_on_time_; }
  std::int64_t round_trip_ns() const { return medians_[legs]; }
  // By the client's clock. The message was answered. Without the server's times only the sender's legs count.
  std::array<Leg, legs> of(const roundtrip::Sample&) const;
  // To be added to a time of the server's clock, for a message sent at that time of the client's clock.
  std::int64_t server_later_ns(std::int64_t sent_ns) const { return -clocks_.at(sent_ns).difference_ns; }
  std::int64_t uncertainty_ns(std::int64_t sent_ns) const { return clocks_.at(sent_ns).uncertainty_ns; }

 private:
  std::array<std::int64_t, legs + 1> medians_{};  // the last: the round trip
  bool is_of_on_time_ = false;
  const Drift clocks_;
};

}  // namespace ontime::explain

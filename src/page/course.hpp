// SPDX-License-Identifier: Apache-2.0
// The course of a run for a browser: each message in two or three bytes, so that a page can hold millions.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>
#include <zlib.h>

#include "record/record.hpp"

namespace ontime::page {

// A time in 16 bits: exact below 4,096 ns, above that to one part in 4,096, up to 73 minutes. A longer time
// has a greater code, or the same, so the greatest of any codes is that of the greatest time.
std::uint16_t code_of(std::int64_t ns);
inline constexpr std::uint16_t code_of_lost = 0xffff;

// Bytes, as RFC 1950 (zlib) and base64 have them.
class Deflated {
 public:
  Deflated();
  ~Deflated();
  Deflated(const Deflated&) = delete;
  Deflated& operator=(const Deflated&) = delete;
  void add(std::uint8_t byte) {
    if (used_ == plain_.size()) pass_on(Z_NO_FLUSH);
    plain_[used_++] = byte;
  }
  void add_number(std::uint64_t);  // LEB128: seven bits a byte, the lowest first
  std::string base64();            // the end: add nothing after it

 private:
  void pass_on(int flush);
  z_stream stream_{};
  std::array<std::uint8_t, 1 << 14> plain_;
  std::size_t used_ = 0;
  std::vector<std::uint8_t> bytes_;
};

// Messages in the order of their index. Of each: when it was due, its round trip, its fate, its index. Where
// there are too many for a page, of each so many the fastest and the slowest answered stand for all, and one
// that was lost.
class Course {
 public:
  // Times count from start_ns. `of` is 1 to keep each message, else how many of them become one.
  Course(std::int64_t start_ns, std::int64_t period_ns, std::uint64_t of);
  void message(const roundtrip::Sample&);
  // {"count", "of", "period_us", and, each deflated: "high", "low" (bytes of the codes), "steps" (from when
  // the one before was due to when this one was, less a period, in µs: 0, -1, 1, -2 … as 0, 1, 2, 3 …),
  // "messages" (4 × those left out before it + fate)}
  nlohmann::json packed();

 private:
  struct Point {
    std::uint64_t index;
    std::int64_t due_us;
    std::uint16_t code;
    roundtrip::Fate fate;
  };
  void put(const Point&);
  void close();

  const std::int64_t start_ns_, period_us_;
  const std::uint64_t of_;
  std::uint64_t count_ = 0, next_index_ = 0, waiting_ = 0;
  std::int64_t last_due_us_;
  std::optional<Point> fastest_, slowest_, lost_;  // of those that wait
  Deflated high_, low_, steps_, messages_;
};

}  // namespace ontime::page

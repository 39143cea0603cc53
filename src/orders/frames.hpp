// SPDX-License-Identifier: Apache-2.0
// What goes through a pipe between two processes of ontime: frames of a message and, where it carries them,
// raw bytes beside it. On the wire: the length of the message (32 bits, little-endian), the number of bytes
// (likewise), the message in CBOR, the bytes.
#pragma once

#include <chrono>
#include <cstdint>
#include <mutex>
#include <optional>
#include <span>
#include <stdexcept>
#include <vector>

#include <nlohmann/json.hpp>

namespace ontime::orders {

struct Broken : std::runtime_error {  // the other end is gone, or speaks something else
  using std::runtime_error::runtime_error;
};

struct Frame {
  nlohmann::json message;  // an object
  std::vector<std::uint8_t> bytes;
};

// What has come, cut into frames. What came may be anything: a shell's complaint, an attack.
class Decoder {
 public:
  void add(std::span<const std::uint8_t> bytes) { buffer_.insert(buffer_.end(), bytes.begin(), bytes.end()); }
  // The next whole frame. Throws Broken for what is none.
  std::optional<Frame> take();

 private:
  std::vector<std::uint8_t> buffer_;
  std::size_t begin_ = 0;  // what lies before it has been taken
};

// Both directions over a pair of file descriptors. Throws Broken.
class Frames {
 public:
  Frames(int in, int out);
  // Any thread. Waits while the pipe is full, but no longer than `patience`: then the other end is stuck.
  void send(const nlohmann::json& message, std::span<const std::uint8_t> bytes = {});
  // One thread. Reads what is there now, without waiting; false if nothing was.
  bool fill();
  std::optional<Frame> take() { return decoder_.take(); }
  int in() const { return in_; }

 private:
  int in_, out_;
  std::mutex sending_;
  Decoder decoder_;
};

}  // namespace ontime::orders

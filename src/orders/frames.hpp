// SPDX-License-Identifier: Apache-2.0
// What goes through a pipe between two processes of ontime: frames of a message and, where it carries them,
// raw bytes beside it. On the wire: the length of the message (32 bits, little-endian), the number of bytes
// (32 bits too), the message in CBOR, the bytes.
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <mutex>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>
#include <sys/uio.h>

namespace ontime::orders {

struct Broken : std::runtime_error {  // the peer is gone, or does not speak the protocol
  using std::runtime_error::runtime_error;
};

struct Frame {
  nlohmann::json message;  // an object
  std::vector<std::uint8_t> bytes;
};

// Cuts received bytes into frames. They may be anything: a shell's error message, an attack.
class Decoder {
 public:
  void add(std::span<const std::uint8_t> bytes) { buffer_.insert(buffer_.end(), bytes.begin(), bytes.end()); }
  // The next whole frame. Throws Broken if the bytes are not a frame.
  std::optional<Frame> take();
  // Received bytes that are not a frame, if they are text (a shell's error message): lines of ASCII, not too
  // many. Else "".
  std::string text() const;

 private:
  std::vector<std::uint8_t> buffer_;
  std::size_t begin_ = 0;  // what lies before it has been taken
};

// Both directions over a pair of file descriptors. Throws Broken.
class Frames {
 public:
  Frames(int in, int out);
  // Any thread. Waits while the pipe is full, but no longer than `patience`: then the peer is stuck.
  void send(const nlohmann::json& message, std::span<const std::uint8_t> bytes = {});
  // Sends raw bytes before all frames, for a program between this process and the worker.
  void put(std::span<const std::uint8_t> bytes, std::chrono::milliseconds patience);
  // One thread. Reads what is there now, without waiting; false if nothing was.
  bool fill();
  std::optional<Frame> take() { return decoder_.take(); }
  std::string text() const { return decoder_.text(); }
  int in() const { return in_; }

 private:
  using Parts = std::array<iovec, 2>;
  void write(Parts parts, std::chrono::milliseconds patience);

  int in_, out_;
  std::mutex sending_;
  Decoder decoder_;
};

}  // namespace ontime::orders

// SPDX-License-Identifier: Apache-2.0
// Frames over a pair of file descriptors: a 32-bit little-endian length, and that many bytes of CBOR.
#pragma once

#include <chrono>
#include <optional>
#include <stdexcept>
#include <vector>

#include <nlohmann/json.hpp>

namespace ontime::agent {

struct Broken : std::runtime_error {  // the other end is gone, or speaks something else
  using std::runtime_error::runtime_error;
};

class Frames {
 public:
  Frames(int in, int out) : in_(in), out_(out) {}
  void send(const nlohmann::json&);
  // Nothing if no whole frame came in time, or a signal came.
  std::optional<nlohmann::json> receive(std::chrono::milliseconds within);

 private:
  std::optional<nlohmann::json> take();
  int in_, out_;
  std::vector<std::uint8_t> buffer_;
};

}  // namespace ontime::agent

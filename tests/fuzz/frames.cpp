// SPDX-License-Identifier: Apache-2.0
// What comes through a pipe is frames, or it is refused; however it is cut, the frames are the same. A task
// that arrives is one that can be sent on, or it is refused.
#include "orders/frames.hpp"

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <utility>
#include <vector>

#include "agent/agent.hpp"

namespace orders = ontime::orders;

namespace {

struct Taken {
  std::vector<orders::Frame> frames;
  bool refused = false;
};

Taken taken(const std::uint8_t* data, std::size_t size, std::size_t piece) {
  Taken result;
  orders::Decoder decoder;
  try {
    for (std::size_t at = 0; at < size; at += piece) {
      decoder.add({data + at, std::min(piece, size - at)});
      while (auto frame = decoder.take()) result.frames.push_back(std::move(*frame));
    }
  } catch (const orders::Broken&) {
    result.refused = true;
  }
  return result;
}

// By its CBOR: a number may be NaN, which is not even equal to itself.
bool same(const orders::Frame& one, const orders::Frame& other) {
  return one.bytes == other.bytes &&
         nlohmann::json::to_cbor(one.message) == nlohmann::json::to_cbor(other.message);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto whole = taken(data, size, size + 1), pieces = taken(data, size, 7);
  if (whole.refused != pieces.refused || !std::ranges::equal(whole.frames, pieces.frames, same)) std::abort();
  for (const auto& [message, bytes] : whole.frames) try {
      if (message.contains("task")) ontime::agent::to_json(ontime::agent::task_of(message.at("task")));
    } catch (const std::exception&) {  // said to the coordinator
    }
  return 0;
}

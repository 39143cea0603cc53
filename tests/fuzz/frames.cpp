// SPDX-License-Identifier: Apache-2.0
// What comes through a pipe is frames, or it is refused; however it is cut, the frames are the same. A task
// that arrives is one that can be sent on, or it is refused.
#include "orders/frames.hpp"

#include <cstdint>
#include <cstdlib>
#include <vector>

#include "agent/agent.hpp"

namespace orders = ontime::orders;

namespace {

std::vector<nlohmann::json> messages(const std::uint8_t* data, std::size_t size, std::size_t piece) {
  orders::Decoder decoder;
  std::vector<nlohmann::json> taken;
  try {
    for (std::size_t at = 0; at < size; at += piece) {
      decoder.add({data + at, std::min(piece, size - at)});
      while (auto frame = decoder.take()) taken.push_back(std::move(frame->message));
    }
  } catch (const orders::Broken&) {
    taken.emplace_back("refused");
  }
  return taken;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto whole = messages(data, size, size + 1);
  if (whole != messages(data, size, 7)) std::abort();
  for (const auto& message : whole) try {
      if (message.is_object() && message.contains("task"))
        nlohmann::json(message.at("task").get<ontime::agent::Task>());
    } catch (const std::exception&) {  // said to the coordinator
    }
  return 0;
}

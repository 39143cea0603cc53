// SPDX-License-Identifier: Apache-2.0
#include "agent/frames.hpp"

#include <array>
#include <cerrno>
#include <cstring>

#include <poll.h>
#include <unistd.h>

namespace ontime::agent {
namespace {

constexpr std::size_t largest = std::size_t{1} << 28;

}  // namespace

void Frames::send(const nlohmann::json& frame) {
  std::vector<std::uint8_t> bytes(sizeof(std::uint32_t));
  nlohmann::json::to_cbor(frame, bytes);
  const auto length = static_cast<std::uint32_t>(bytes.size() - sizeof(std::uint32_t));
  std::memcpy(bytes.data(), &length, sizeof length);
  for (std::size_t done = 0; done < bytes.size();) {
    const auto written = write(out_, bytes.data() + done, bytes.size() - done);
    if (written > 0) done += static_cast<std::size_t>(written);
    if (written < 0 && errno != EINTR) throw Broken("the other end of the pipe is gone");
  }
}

std::optional<nlohmann::json> Frames::receive(std::chrono::milliseconds within) {
  if (auto frame = take()) return frame;
  const auto until = std::chrono::steady_clock::now() + within;
  do {
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(until - std::chrono::steady_clock::now());
    pollfd waiting{in_, POLLIN, 0};
    const int ready = poll(&waiting, 1, static_cast<int>(std::max<std::int64_t>(left.count(), 0)));
    if (ready <= 0) return {};
    std::array<std::uint8_t, 65536> bytes{};
    const auto got = read(in_, bytes.data(), bytes.size());
    if (got == 0) throw Broken("the other end of the pipe is gone");
    if (got < 0 && errno != EINTR && errno != EAGAIN)
      throw Broken(std::strerror(errno));  // NOLINT(concurrency-mt-unsafe)
    if (got > 0) buffer_.insert(buffer_.end(), bytes.begin(), bytes.begin() + got);
    if (auto frame = take()) return frame;
  } while (std::chrono::steady_clock::now() < until);
  return {};
}

std::optional<nlohmann::json> Frames::take() {
  std::uint32_t length = 0;
  if (buffer_.size() < sizeof length) return {};
  std::memcpy(&length, buffer_.data(), sizeof length);
  if (length > largest) throw Broken("the other end does not speak ontime's orders");
  if (buffer_.size() < sizeof length + length) return {};
  const auto begin = buffer_.begin() + sizeof length;
  auto frame = nlohmann::json::from_cbor(begin, begin + length, true, false);
  if (frame.is_discarded()) throw Broken("the other end does not speak ontime's orders");
  buffer_.erase(buffer_.begin(), begin + length);
  return frame;
}

}  // namespace ontime::agent

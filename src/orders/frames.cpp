// SPDX-License-Identifier: Apache-2.0
#include "orders/frames.hpp"

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cstring>
#include <system_error>

#include <fcntl.h>
#include <poll.h>
#include <unistd.h>

#include "orders/orders.hpp"

namespace ontime::orders {
namespace {

constexpr std::size_t header_bytes = 8;
constexpr std::size_t largest_message = std::size_t{16} << 20;
constexpr std::size_t largest_bytes = std::size_t{64} << 20;
constexpr int deepest = 32;
constexpr std::size_t kept = std::size_t{1} << 20;  // of what has been taken: moving the rest costs, too
constexpr const char* foreign = "the peer does not speak ontime's protocol";
constexpr const char* gone = "the peer closed the pipe";

// The parser calls itself for each level: how many there are must not be the sender's choice.
class Shallow final : public nlohmann::json_sax<nlohmann::json> {
 public:
  bool null() override { return true; }
  bool boolean(bool) override { return true; }
  bool number_integer(number_integer_t) override { return true; }
  bool number_unsigned(number_unsigned_t) override { return true; }
  bool number_float(number_float_t, const string_t&) override { return true; }
  bool string(string_t&) override { return true; }
  bool binary(binary_t&) override { return true; }
  bool key(string_t&) override { return true; }
  bool start_object(std::size_t) override { return ++depth_ <= deepest; }
  bool end_object() override { return --depth_ >= 0; }
  bool start_array(std::size_t) override { return ++depth_ <= deepest; }
  bool end_array() override { return --depth_ >= 0; }
  bool parse_error(std::size_t, const std::string&, const nlohmann::json::exception&) override {
    return false;
  }

 private:
  int depth_ = 0;
};

nlohmann::json message_of(std::span<const std::uint8_t> cbor) {
  Shallow shallow;
  if (!nlohmann::json::sax_parse(cbor.begin(), cbor.end(), &shallow, nlohmann::json::input_format_t::cbor))
    throw Broken(foreign);
  auto message = nlohmann::json::from_cbor(cbor.begin(), cbor.end(), true, false);
  if (!message.is_object()) throw Broken(foreign);
  return message;
}

std::uint32_t number_at(const std::uint8_t* at) {
  std::uint32_t number = 0;
  std::memcpy(&number, at, sizeof number);
  return number;
}

}  // namespace

std::optional<Frame> Decoder::take() {
  const std::span<const std::uint8_t> there(buffer_.data() + begin_, buffer_.size() - begin_);
  if (there.size() < header_bytes) return {};
  const std::size_t message_bytes = number_at(there.data()), raw_bytes = number_at(there.data() + 4);
  if (message_bytes > largest_message || raw_bytes > largest_bytes) throw Broken(foreign);
  const std::size_t whole = header_bytes + message_bytes + raw_bytes;
  if (there.size() < whole) return {};
  Frame frame{message_of(there.subspan(header_bytes, message_bytes)), {}};
  const auto raw = there.subspan(header_bytes + message_bytes, raw_bytes);
  frame.bytes.assign(raw.begin(), raw.end());
  begin_ += whole;
  if (begin_ == buffer_.size() || begin_ > kept) {
    buffer_.erase(buffer_.begin(), buffer_.begin() + static_cast<std::ptrdiff_t>(begin_));
    begin_ = 0;
  }
  return frame;
}

std::string Decoder::text() const {
  constexpr std::size_t enough = 2000;
  const auto first = buffer_.begin() + static_cast<std::ptrdiff_t>(begin_);
  const auto limit = first + static_cast<std::ptrdiff_t>(std::min(buffer_.size() - begin_, enough));
  const auto is_text = [](std::uint8_t c) { return (c >= ' ' && c != 0x7f) || std::isspace(c) != 0; };
  std::string text(first, std::find_if_not(first, limit, is_text));
  if (text.size() < sizeof(std::uint32_t)) return "";  // no length of a frame is so long that it is text
  std::replace_if(
      text.begin(), text.end(), [](char c) { return static_cast<unsigned char>(c) > 0x7f; }, '?');
  text.erase(text.find_last_not_of(" \r\n") + 1);
  return text;
}

Frames::Frames(int in, int out) : in_(in), out_(out) {
  for (const int fd : {in, out}) fcntl(fd, F_SETFL, fcntl(fd, F_GETFL) | O_NONBLOCK);
}

void Frames::send(const nlohmann::json& message, std::span<const std::uint8_t> bytes) {
  std::vector<std::uint8_t> head(header_bytes);
  nlohmann::json::to_cbor(message, head);
  const auto message_bytes = static_cast<std::uint32_t>(head.size() - header_bytes);
  const auto raw_bytes = static_cast<std::uint32_t>(bytes.size());
  std::memcpy(head.data(), &message_bytes, sizeof message_bytes);
  std::memcpy(head.data() + 4, &raw_bytes, sizeof raw_bytes);
  write({iovec{head.data(), head.size()}, iovec{const_cast<std::uint8_t*>(bytes.data()), bytes.size()}},
        longest_silence);
}

void Frames::put(std::span<const std::uint8_t> bytes, std::chrono::milliseconds patience) {
  write({iovec{const_cast<std::uint8_t*>(bytes.data()), bytes.size()}, iovec{}}, patience);
}

void Frames::write(Parts parts, std::chrono::milliseconds patience) {
  const std::lock_guard lock(sending_);
  for (std::size_t part = 0; part < parts.size();) {
    if (parts[part].iov_len == 0) {
      ++part;
      continue;
    }
    auto written = writev(out_, &parts[part], static_cast<int>(parts.size() - part));
    if (written < 0 && errno == EAGAIN) {
      pollfd room{out_, POLLOUT, 0};
      if (poll(&room, 1, static_cast<int>(patience.count())) == 0)
        throw Broken("the peer does not read from the pipe");
      continue;
    }
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) throw Broken(gone);
    for (; part < parts.size() && written > 0; part += parts[part].iov_len == 0 ? 1U : 0U) {
      const auto taken = std::min(static_cast<std::size_t>(written), parts[part].iov_len);
      parts[part].iov_base = static_cast<std::uint8_t*>(parts[part].iov_base) + taken;
      parts[part].iov_len -= taken;
      written -= static_cast<ssize_t>(taken);
    }
  }
}

bool Frames::fill() {
  std::array<std::uint8_t, 65536> bytes;
  const auto got = read(in_, bytes.data(), bytes.size());
  if (got == 0) throw Broken(gone);
  if (got < 0 && errno != EINTR && errno != EAGAIN) throw Broken(std::generic_category().message(errno));
  if (got > 0) decoder_.add({bytes.data(), static_cast<std::size_t>(got)});
  return got > 0;
}

}  // namespace ontime::orders

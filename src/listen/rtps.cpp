// SPDX-License-Identifier: Apache-2.0
#include "listen/rtps.hpp"

#include <algorithm>
#include <cstring>

#include <fmt/format.h>

namespace ontime::listen::rtps {
namespace {

using Bytes = std::span<const std::byte>;

constexpr std::size_t header_bytes = 20;
constexpr std::size_t longest_name = 256;
constexpr std::array<std::uint8_t, 4> publications_writer{0x00, 0x00, 0x03, 0xc2},
    subscriptions_writer{0x00, 0x00, 0x04, 0xc2};

// Reads from the front; bytes beyond the end read as zero, and is_beyond() becomes true.
class Reader {
 public:
  Reader(Bytes bytes, bool is_little_endian) : bytes_(bytes), is_little_(is_little_endian) {}

  template <class Number>
  Number number() {
    Number value = 0;
    for (std::size_t i = 0; i < sizeof value; ++i) {
      const auto byte = static_cast<Number>(at(position_ + (is_little_ ? sizeof value - 1 - i : i)));
      value = static_cast<Number>(value << 8U | byte);
    }
    position_ += sizeof value;
    return value;
  }
  template <std::size_t Size>
  std::array<std::uint8_t, Size> bytes() {
    std::array<std::uint8_t, Size> result{};
    for (auto& byte : result) byte = at(position_++);
    return result;
  }
  // Zero: invalid (numbers begin with 1, and the high half is signed).
  std::uint64_t sequence() {
    const auto high = number<std::uint32_t>();
    const auto low = number<std::uint32_t>();
    return high >= 0x80000000U ? 0 : std::uint64_t{high} << 32U | low;
  }
  void skip(std::size_t count) { position_ += count; }
  std::size_t position() const { return position_; }
  bool is_beyond() const { return position_ > bytes_.size(); }
  Bytes rest() const { return bytes_.subspan(std::min(position_, bytes_.size())); }

 private:
  std::uint8_t at(std::size_t i) const {
    return i < bytes_.size() ? std::to_integer<std::uint8_t>(bytes_[i]) : 0;
  }
  Bytes bytes_;
  bool is_little_;
  std::size_t position_ = 0;
};

class Datagram {
 public:
  explicit Datagram(const Visitor& visitor) : visitor_(visitor) {}

  void visit(Bytes bytes, bool is_cut) {
    if (bytes.size() < header_bytes || std::memcmp(bytes.data(), "RTPS", 4) != 0) return;
    std::memcpy(prefix_.data(), bytes.data() + 8, prefix_.size());
    bytes = bytes.subspan(header_bytes);
    while (bytes.size() >= 4) {
      const auto kind = std::to_integer<std::uint8_t>(bytes[0]),
                 flags = std::to_integer<std::uint8_t>(bytes[1]);
      std::size_t size = Reader(bytes.subspan(2), flags & 1U).number<std::uint16_t>();
      bytes = bytes.subspan(4);
      // The last submessage may leave its length out; padding and time stamps may be empty.
      if (size == 0 && kind != pad && kind != info_timestamp) size = bytes.size();
      if (size > bytes.size() && !is_cut) return;
      size = std::min(size, bytes.size());
      is_cut_ = is_cut && size == bytes.size();
      submessage(kind, flags, bytes.first(size));
      bytes = bytes.subspan(size);
    }
  }

 private:
  static constexpr std::uint8_t pad = 0x01, gap = 0x08, heartbeat = 0x07, info_timestamp = 0x09,
                                info_source = 0x0c, data = 0x15, data_fragment = 0x16;

  void submessage(std::uint8_t kind, std::uint8_t flags, Bytes bytes) {
    Reader in(bytes, flags & 1U);
    switch (kind) {
      case info_timestamp:
        return take_stamp(in, flags);
      case info_source:
        in.skip(8);
        prefix_ = in.bytes<12>();
        return;
      case data:
      case data_fragment:
        return take_data(in, flags, kind == data_fragment);
      case gap:
        return take_gap(in);
      case heartbeat:
        return take_heartbeat(in);
      default:
        return;
    }
  }

  void take_stamp(Reader in, std::uint8_t flags) {
    stamp_ns_.reset();
    const std::int64_t seconds = in.number<std::uint32_t>();
    const std::uint64_t fraction = in.number<std::uint32_t>();  // of 2⁻³² s
    constexpr std::uint32_t infinite = 0x7fffffff;
    if ((flags & 2U) != 0 || in.is_beyond() || seconds >= infinite) return;
    // Rounded up: implementations round down when they make the fraction.
    stamp_ns_ =
        seconds * 1'000'000'000 + static_cast<std::int64_t>((fraction * 1'000'000'000 + 0xffffffffU) >> 32U);
  }

  Guid guid(const std::array<std::uint8_t, 4>& entity) const {
    Guid result;
    std::copy(prefix_.begin(), prefix_.end(), result.bytes.begin());
    std::copy(entity.begin(), entity.end(), result.bytes.begin() + prefix_.size());
    return result;
  }

  void take_data(Reader in, std::uint8_t flags, bool is_fragment) {
    in.skip(2);
    const std::size_t to_qos = in.number<std::uint16_t>();
    const auto qos_at = in.position() + to_qos;
    in.skip(4);  // the reader
    Data found;
    found.writer = guid(in.bytes<4>());
    found.sequence = in.sequence();
    found.stamp_ns = stamp_ns_;
    std::uint64_t needed = 0;  // bytes of payload
    if (is_fragment) {
      Fragments fragments;
      fragments.first = in.number<std::uint32_t>();
      fragments.count = in.number<std::uint16_t>();
      const std::uint64_t fragment_bytes = in.number<std::uint16_t>();
      const auto bytes = in.number<std::uint32_t>();
      if (fragment_bytes == 0 || fragments.first == 0 || fragments.count == 0) return;
      fragments.total = static_cast<std::uint32_t>((bytes + fragment_bytes - 1) / fragment_bytes);
      if (fragments.first > fragments.total || fragments.count > fragments.total - fragments.first + 1)
        return;
      const auto before = (fragments.first - 1) * fragment_bytes;
      needed = std::min(fragments.count * fragment_bytes, bytes - before);
      found.fragments = fragments;
    }
    if (in.is_beyond() || found.sequence == 0 || qos_at < in.position()) return;
    in.skip(qos_at - in.position());
    // A key without data ends an instance: it has a number, but is not a message.
    const bool has_qos = (flags & 2U) != 0, has_payload = is_fragment || (flags & 4U) != 0;
    if (has_qos && !skip_parameters(in)) return;
    if (!has_payload) {
      if (visitor_.gap) visitor_.gap({found.writer, found.sequence, found.sequence, true});
      return;
    }
    found.payload = in.rest();
    if (found.payload.size() < needed && !is_cut_) return;
    if (visitor_.data) visitor_.data(found);
  }

  static bool skip_parameters(Reader& in) {
    while (!in.is_beyond()) {
      const auto id = in.number<std::uint16_t>();
      const auto size = in.number<std::uint16_t>();
      if (id == 1) return !in.is_beyond();
      in.skip(size);
    }
    return false;
  }

  void take_gap(Reader in) {
    in.skip(4);
    const auto writer = guid(in.bytes<4>());
    const auto first = in.sequence(), base = in.sequence();
    const auto bits = in.number<std::uint32_t>();
    if (in.is_beyond() || first == 0 || base < first || bits > 256 || !visitor_.gap) return;
    if (base > first) visitor_.gap({writer, first, base - 1});
    std::uint32_t word = 0;
    for (std::uint32_t bit = 0; bit < bits; ++bit) {
      if (bit % 32 == 0) word = in.number<std::uint32_t>();
      if (in.is_beyond()) return;
      if ((word & (0x80000000U >> (bit % 32))) != 0) visitor_.gap({writer, base + bit, base + bit});
    }
  }

  void take_heartbeat(Reader in) {
    in.skip(4);
    const auto writer = guid(in.bytes<4>());
    const auto first = in.sequence(), last = in.sequence();
    if (!in.is_beyond() && first != 0 && visitor_.heartbeat) visitor_.heartbeat({writer, first, last});
  }

  const Visitor& visitor_;
  std::array<std::uint8_t, 12> prefix_{};
  std::optional<std::int64_t> stamp_ns_;
  bool is_cut_ = false;  // the submessage, by the capture
};

std::string string_of(Reader in, std::size_t size) {
  const std::size_t length = in.number<std::uint32_t>();
  if (length == 0 || length > std::min(size, longest_name) || in.rest().size() < length) return "";
  const auto* const text = reinterpret_cast<const char*>(in.rest().data());
  return {text, strnlen(text, length)};
}

}  // namespace

void visit(std::span<const std::byte> datagram, const Visitor& visitor, bool is_cut) {
  Datagram(visitor).visit(datagram, is_cut);
}

std::optional<Endpoint> announced(const Data& data) {
  const auto is_of = [&](const auto& entity) {
    return std::equal(entity.begin(), entity.end(), data.writer.bytes.begin() + 12);
  };
  const bool is_reader = is_of(subscriptions_writer);
  if (data.fragments || data.payload.size() < 4 || (!is_reader && !is_of(publications_writer))) return {};
  constexpr std::uint8_t parameters_big_endian = 2, parameters_little_endian = 3;
  const auto form = std::to_integer<std::uint8_t>(data.payload[1]);
  if (data.payload[0] != std::byte{0} || (form != parameters_big_endian && form != parameters_little_endian))
    return {};
  constexpr std::uint16_t sentinel = 1, topic_name = 5, type_name = 7, endpoint_guid = 0x5a;
  Endpoint endpoint;
  endpoint.is_reader = is_reader;
  Reader in(data.payload.subspan(4), form == parameters_little_endian);
  while (!in.is_beyond() && !in.rest().empty()) {
    const auto id = static_cast<std::uint16_t>(in.number<std::uint16_t>() & 0x3fffU);
    const auto size = in.number<std::uint16_t>();
    if (id == sentinel || in.rest().size() < size) break;
    if (id == topic_name) endpoint.topic = string_of(in, size);
    if (id == type_name) endpoint.type = string_of(in, size);
    if (id == endpoint_guid && size >= 16) endpoint.guid.bytes = Reader(in).bytes<16>();
    in.skip(size);
  }
  if (endpoint.topic.empty() || endpoint.guid == Guid{}) return {};
  return endpoint;
}

std::string text_of(const Guid& guid) {
  const auto part = [&](std::size_t at) { return fmt::join(std::span(guid.bytes).subspan(at, 4), ""); };
  return fmt::format("{:02x}.{:02x}.{:02x}:{:02x}", part(0), part(4), part(8), part(12));
}

}  // namespace ontime::listen::rtps

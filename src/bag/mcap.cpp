// SPDX-License-Identifier: Apache-2.0
// MCAP, as https://mcap.dev/spec describes it: records, each of an opcode, a length and a body; chunks of
// records may be compressed. Read from the front to the end of the data, without the index behind it: that is
// missing where the recorder was killed.
#include <array>
#include <map>

#include <fmt/format.h>
#include <zlib.h>

#include "bag/bytes.hpp"
#include "bag/header.hpp"
#include "bag/reader.hpp"
#include "listen/listen.hpp"

namespace ontime::bag {
namespace {

constexpr std::size_t magic_bytes = 8, record_head_bytes = 9;
constexpr std::uint64_t most_description_bytes = 4 << 20;  // of a schema or a channel
constexpr std::uint64_t most_chunk_bytes = 4ULL << 30U;    // decompressed
namespace opcode {
constexpr unsigned footer = 2, schema = 3, channel = 4, message = 5, chunk = 6, data_end = 15;
}

struct Short {};  // there are fewer bytes than a record needs
struct Damage {
  std::string what;
};

template <class Number>
Number little(std::span<const std::byte> bytes) {
  std::uint64_t number = 0;
  for (std::size_t i = 0; i < sizeof(Number); ++i)
    number |= std::to_integer<std::uint64_t>(bytes[i]) << (8 * i);
  return static_cast<Number>(number);
}

void read_exactly(Bytes& from, std::span<std::byte> to) {
  if (from.read(to) < to.size()) throw Short{};
}

template <class Number>
Number read_number(Bytes& from) {
  std::array<std::byte, sizeof(Number)> bytes;
  read_exactly(from, bytes);
  return little<Number>(bytes);
}

std::string read_text(Bytes& from, std::uint64_t most) {
  const auto length = read_number<std::uint32_t>(from);
  if (length > most) throw Damage{fmt::format("a text of {} bytes (maximum: {})", length, most)};
  std::string text(length, '\0');
  read_exactly(from, std::as_writable_bytes(std::span(text)));
  return text;
}

std::int64_t time_of(std::uint64_t ns) {
  if (ns > static_cast<std::uint64_t>(latest_ns))
    throw Damage{fmt::format("a message with the invalid time {} ns", ns)};
  return static_cast<std::int64_t>(ns);
}

// The records of a chunk, decompressed.
class Chunk final : public Bytes {
 public:
  Chunk(Bytes& file, std::uint64_t length) : body_(file, length) {
    if (!body_.skip(16)) throw Short{};  // the times of its messages
    const auto size = read_number<std::uint64_t>(body_);
    expected_ = read_number<std::uint32_t>(body_);
    const auto compression = read_text(body_, 32);
    const auto stored = read_number<std::uint64_t>(body_);
    if (stored > body_.left()) throw Damage{"a chunk longer than its record"};
    if (size > most_chunk_bytes)
      throw Damage{fmt::format("a chunk of {} bytes (maximum: {})", size, most_chunk_bytes)};
    stored_.emplace(body_, stored);
    if (compression.empty()) {
      if (stored != size)
        throw Damage{fmt::format("a chunk of {} bytes, but its header states {}", stored, size)};
    } else if (compression == "lz4" || compression == "zstd") {
      decompressed_.emplace(*stored_, compression == "lz4" ? Compression::lz4 : Compression::zstd);
    } else {
      throw Damage{fmt::format("a chunk compressed with '{}' (supported: lz4, zstd)", compression)};
    }
    records_.emplace(decompressed_ ? static_cast<Bytes&>(*decompressed_) : *stored_, size);
  }
  // skip() reads too, so that the checksum covers all bytes.
  std::size_t read(std::span<std::byte> to) override {
    const auto count = records_->read(to);
    sum_ = crc32_z(sum_, reinterpret_cast<const Bytef*>(to.data()), count);
    return count;
  }
  std::uint64_t left() const { return records_->left(); }
  // Further bytes of the record belong to a later version of the format.
  void finish() {
    if (expected_ != 0 && expected_ != sum_) throw Damage{"a chunk with a checksum error"};
    if (!stored_->skip_rest() || !body_.skip_rest()) throw Short{};
  }
  std::string error() const { return decompressed_ ? decompressed_->error() : std::string(); }

 private:
  Part body_;
  std::uint32_t expected_ = 0;  // 0: it has no checksum
  uLong sum_ = crc32_z(0, nullptr, 0);
  std::optional<Part> stored_;
  std::optional<Decompressed> decompressed_;
  std::optional<Part> records_;
};

class Mcap final : public Reader {
 public:
  explicit Mcap(const std::string& path) : path_(path), file_(path) { file_.skip(magic_bytes); }

  std::optional<Message> next() override {
    try {
      return next_message();
    } catch (const Short&) {
      end_short();
      return {};
    } catch (const Damage& damage) {
      fail(damage.what);
    }
  }

  std::string cut() const override { return cut_; }

 private:
  [[noreturn]] void fail(const std::string& what) const {
    throw listen::WrongInput(fmt::format("{}: damaged at byte {}{}: {}. Try: mcap recover", path_, record_at_,
                                         chunk_ ? ", in a chunk" : "", what));
  }

  void end_short() {
    if (!file_.error().empty())
      throw listen::Error(fmt::format("{}: at byte {}: {}", path_, file_.offset(), file_.error()));
    if (!file_.has_ended()) {
      const auto error = chunk_ ? chunk_->error() : std::string();
      fail(error.empty() ? "a record with a length that does not match its content"
                         : fmt::format("data that cannot be decompressed: {}", error));
    }
    cut_ = fmt::format("ends at byte {}, {}", file_.offset(),
                       file_.offset() == record_at_ ? "without an end mark" : "within a record");
    has_ended_ = true;
  }

  std::optional<Message> next_message() {
    while (!has_ended_) {
      if (chunk_ && chunk_->left() == 0) {
        chunk_->finish();
        chunk_.reset();
      }
      if (!chunk_) record_at_ = file_.offset();
      auto& from = chunk_ ? static_cast<Bytes&>(*chunk_) : file_;
      std::array<std::byte, record_head_bytes> head;
      read_exactly(from, head);
      const auto code = std::to_integer<unsigned>(head[0]);
      const auto length = little<std::uint64_t>(std::span(head).subspan(1));
      if (code == 0) throw Damage{"an invalid record"};
      if (chunk_ && length > chunk_->left()) throw Damage{"a record longer than its chunk"};
      if (code == opcode::chunk && !chunk_) {
        chunk_.emplace(file_, length);
        continue;
      }
      if (!chunk_ && (code == opcode::data_end || code == opcode::footer)) break;
      Part body(from, length);
      const auto read = take(code, body);
      if (!body.skip_rest()) throw Short{};
      if (read) return read;
    }
    has_ended_ = true;
    return {};
  }

  std::optional<Message> take(unsigned code, Part& body) {
    if (code == opcode::message) return message_of(body);
    if (code != opcode::schema && code != opcode::channel) return {};
    if (body.left() > most_description_bytes)
      throw Damage{
          fmt::format("a description of {} bytes (maximum: {})", body.left(), most_description_bytes)};
    if (code == opcode::schema)
      add_schema(body);
    else
      add_channel(body);
    return {};
  }

  void add_schema(Part& body) {
    const auto id = read_number<std::uint16_t>(body);
    const auto name = read_text(body, longest_name);
    const auto encoding = read_text(body, longest_name);
    has_header_[id] = begins_with_header(name, encoding, read_text(body, most_description_bytes));
  }

  void add_channel(Part& body) {
    const auto id = read_number<std::uint16_t>(body);
    const auto schema_id = read_number<std::uint16_t>(body);
    auto name = read_text(body, longest_name);
    const auto encoding = read_text(body, longest_name);
    const auto known = channels_.find(id);
    if (known != channels_.end() && known->second.name != name)
      throw Damage{fmt::format("channel {} again, with another topic", id)};
    if (known != channels_.end()) return;
    const auto writer = writers_[name]++;
    const auto found = has_header_.find(schema_id);
    channels_[id] = {std::move(name), writer,
                     encoding == "cdr" && found != has_header_.end() && found->second};
  }

  Message message_of(Part& body) {
    const auto id = read_number<std::uint16_t>(body);
    const auto channel = channels_.find(id);
    if (channel == channels_.end()) throw Damage{fmt::format("a message of the unknown channel {}", id)};
    Message message{.topic = &channel->second};
    message.sequence = read_number<std::uint32_t>(body);
    message.recorded_ns = time_of(read_number<std::uint64_t>(body));
    message.published_ns = time_of(read_number<std::uint64_t>(body));
    if (message.topic->has_header) {
      std::array<std::byte, stamp_end> begin;
      message.stamp_ns = stamp_of(std::span(begin).first(body.read(begin)));
    }
    return message;
  }

  const std::string path_;
  File file_;
  std::optional<Chunk> chunk_;
  std::uint64_t record_at_ = 0;               // in the file; of a record in a chunk, the chunk's
  std::map<std::uint16_t, bool> has_header_;  // by schema
  std::map<std::uint16_t, Topic> channels_;
  std::map<std::string, unsigned> writers_;  // how many channels a topic has
  bool has_ended_ = false;
  std::string cut_;
};

}  // namespace

std::unique_ptr<Reader> read_mcap(const std::string& path) { return std::make_unique<Mcap>(path); }

}  // namespace ontime::bag

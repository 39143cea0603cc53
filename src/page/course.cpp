// SPDX-License-Identifier: Apache-2.0
#include "page/course.hpp"

#include <algorithm>
#include <bit>
#include <map>
#include <utility>

#include <sodium.h>

#include "statistics/wrapping.hpp"

namespace ontime::page {
namespace {

constexpr int kept_bits = 11;  // of a time, after its first

using statistics::between;

std::uint64_t zigzag(std::int64_t value) {
  return (static_cast<std::uint64_t>(value) << 1) ^ static_cast<std::uint64_t>(value >> 63);
}

}  // namespace

std::uint16_t code_of(std::int64_t ns) {
  const auto value = static_cast<std::uint64_t>(std::max<std::int64_t>(ns, 0));
  const auto width = static_cast<int>(std::bit_width(value));
  const auto shift = static_cast<std::uint64_t>(std::max(width - kept_bits - 1, 0));
  const auto code = (shift << kept_bits) + (value >> shift);
  return static_cast<std::uint16_t>(std::min<std::uint64_t>(code, code_of_lost - 1));
}

Deflated::Deflated() {
  if (deflateInit(&stream_, Z_DEFAULT_COMPRESSION) != Z_OK) throw std::bad_alloc();
}

Deflated::~Deflated() { deflateEnd(&stream_); }

void Deflated::add_number(std::uint64_t value) {
  for (; value > 0x7f; value >>= 7) add(static_cast<std::uint8_t>(value | 0x80));
  add(static_cast<std::uint8_t>(value));
}

void Deflated::pass_on(int flush) {
  std::array<std::uint8_t, 1 << 14> deflated;
  stream_.next_in = plain_.data();
  stream_.avail_in = static_cast<uInt>(used_);
  do {
    stream_.next_out = deflated.data();
    stream_.avail_out = static_cast<uInt>(deflated.size());
    deflate(&stream_, flush);
    bytes_.insert(bytes_.end(), deflated.data(), stream_.next_out);
  } while (stream_.avail_out == 0);
  used_ = 0;
}

std::string Deflated::base64() {
  pass_on(Z_FINISH);
  constexpr int variant = sodium_base64_VARIANT_ORIGINAL;
  std::string text(sodium_base64_encoded_len(bytes_.size(), variant), '\0');
  sodium_bin2base64(text.data(), text.size(), bytes_.data(), bytes_.size(), variant);
  text.pop_back();  // its terminator
  bytes_ = {};
  return text;
}

Course::Course(std::int64_t start_ns, std::int64_t period_ns, std::uint64_t of)
    : start_ns_(start_ns), period_us_(period_ns / 1000), of_(of), last_due_us_(-period_us_) {}

void Course::message(const roundtrip::Sample& sample) {
  const bool lost = sample.fate == roundtrip::Fate::lost;
  const Point point{sample.index, between(start_ns_, sample.due_ns) / 1000,
                    lost ? code_of_lost : code_of(between(sample.sent_ns, sample.received_ns)), sample.fate};
  if (of_ == 1) return put(point);
  if (lost && !lost_) lost_ = point;
  if (!lost && (!fastest_ || point.code < fastest_->code)) fastest_ = point;
  if (!lost && (!slowest_ || point.code > slowest_->code)) slowest_ = point;
  if (++waiting_ == 2 * of_) close();
}

void Course::close() {
  if (waiting_ == 0) return;
  waiting_ = 0;
  std::map<std::uint64_t, Point> in_order;
  for (auto* one : {&fastest_, &slowest_, &lost_})
    if (const auto point = std::exchange(*one, {})) in_order.emplace(point->index, *point);
  for (const auto& [index, point] : in_order) put(point);
}

void Course::put(const Point& point) {
  ++count_;
  high_.add(static_cast<std::uint8_t>(point.code >> 8));
  low_.add(static_cast<std::uint8_t>(point.code));
  steps_.add_number(zigzag(between(last_due_us_, point.due_us) - period_us_));
  messages_.add_number((point.index - next_index_) << 2 | static_cast<std::uint64_t>(point.fate));
  last_due_us_ = point.due_us;
  next_index_ = point.index + 1;
}

nlohmann::json Course::packed() {
  close();
  return {{"count", count_},
          {"of", of_},
          {"period_us", period_us_},
          {"high", high_.base64()},
          {"low", low_.base64()},
          {"steps", steps_.base64()},
          {"messages", messages_.base64()}};
}

}  // namespace ontime::page

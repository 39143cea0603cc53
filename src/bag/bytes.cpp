// SPDX-License-Identifier: Apache-2.0
#include "bag/bytes.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <filesystem>
#include <system_error>

#include <archive.h>
#include <archive_entry.h>

namespace ontime::bag {
namespace {

constexpr std::size_t at_once = 1 << 16;

}  // namespace

bool Bytes::skip(std::uint64_t count) {
  std::array<std::byte, 4096> passed_over;
  while (count > 0) {
    const auto wanted = std::min<std::uint64_t>(count, passed_over.size());
    if (read(std::span(passed_over).first(wanted)) < wanted) return false;
    count -= wanted;
  }
  return true;
}

// Opening something else, such as a FIFO, could wait for ever.
File::File(const std::string& path) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error)) {
    error_ = error ? error.message() : "not a regular file";
    return;
  }
  size_ = std::filesystem::file_size(path, error);
  file_.reset(std::fopen(path.c_str(), "rbe"));
  if (!file_) error_ = std::generic_category().message(errno);
}

std::size_t File::read(std::span<std::byte> to) {
  if (!file_) return 0;
  const auto count = std::fread(to.data(), 1, to.size(), file_.get());
  if (std::ferror(file_.get()) != 0) error_ = std::generic_category().message(errno);
  has_ended_ = has_ended_ || count < to.size();
  offset_ += count;
  return count;
}

bool File::skip(std::uint64_t count) {
  if (count <= at_once) return Bytes::skip(count);  // a seek would read the buffer again
  if (count > size_ - std::min(offset_, size_)) {
    offset_ = size_;
    has_ended_ = true;
    return false;
  }
  if (fseeko(file_.get(), static_cast<off_t>(count), SEEK_CUR) != 0) {
    error_ = std::generic_category().message(errno);
    return false;
  }
  offset_ += count;
  return true;
}

std::size_t Part::read(std::span<std::byte> to) {
  const auto count = of_.read(to.first(std::min<std::uint64_t>(to.size(), left_)));
  left_ -= count;
  return count;
}

bool Part::skip(std::uint64_t count) {
  if (count > left_ || !of_.skip(count)) return false;
  left_ -= count;
  return true;
}

void Decompressed::Free::operator()(archive* reader) const { archive_read_free(reader); }

Decompressed::Decompressed(Bytes& from, Compression compression)
    : from_(from), buffer_(std::make_unique<std::byte[]>(at_once)), archive_(archive_read_new()) {
  auto* const reader = archive_.get();
  archive_read_support_format_raw(reader);
  archive_entry* entry = nullptr;
  if (archive_read_append_filter(
          reader, compression == Compression::zstd ? ARCHIVE_FILTER_ZSTD : ARCHIVE_FILTER_LZ4) ==
          ARCHIVE_OK &&
      archive_read_open(reader, this, nullptr, feed, nullptr) == ARCHIVE_OK) {
    const auto code = archive_read_next_header(reader, &entry);
    has_ended_ = code == ARCHIVE_EOF;
    if (code == ARCHIVE_OK || code == ARCHIVE_EOF) return;
  }
  has_ended_ = true;
  error_ = archive_error_string(reader);
}

std::ptrdiff_t Decompressed::feed(archive*, void* self, const void** bytes) {
  auto& decompressed = *static_cast<Decompressed*>(self);
  *bytes = decompressed.buffer_.get();
  return static_cast<std::ptrdiff_t>(decompressed.from_.read({decompressed.buffer_.get(), at_once}));
}

std::size_t Decompressed::read(std::span<std::byte> to) {
  std::size_t count = 0;
  while (count < to.size() && !has_ended_) {
    const auto got = archive_read_data(archive_.get(), to.data() + count, to.size() - count);
    if (got < 0) error_ = archive_error_string(archive_.get());
    if (got <= 0)
      has_ended_ = true;
    else
      count += static_cast<std::size_t>(got);
  }
  return count;
}

}  // namespace ontime::bag

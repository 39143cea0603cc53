// SPDX-License-Identifier: Apache-2.0
// Reads bytes of a file, of a part of it, and of compressed data in a part. Constant memory; no throws.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <span>
#include <string>

struct archive;

namespace ontime::bag {

class Bytes {
 public:
  Bytes() = default;
  virtual ~Bytes() = default;
  Bytes(const Bytes&) = delete;
  Bytes& operator=(const Bytes&) = delete;
  // Returns the number of bytes read: fewer than requested at the end, or after an error.
  virtual std::size_t read(std::span<std::byte> to) = 0;
  // Skips the next bytes; false: there are fewer.
  virtual bool skip(std::uint64_t count);
};

class File final : public Bytes {
 public:
  explicit File(const std::string& path);  // a regular file; else error() says why it cannot be read
  std::size_t read(std::span<std::byte> to) override;
  bool skip(std::uint64_t count) override;
  std::uint64_t offset() const { return offset_; }
  bool has_ended() const { return has_ended_; }  // a read or skip went beyond the end
  const std::string& error() const { return error_; }

 private:
  struct Close {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  std::unique_ptr<std::FILE, Close> file_;
  std::uint64_t offset_ = 0, size_ = 0;
  bool has_ended_ = false;
  std::string error_;
};

// The next bytes of another object, which must outlive it.
class Part final : public Bytes {
 public:
  Part(Bytes& of, std::uint64_t length) : of_(of), left_(length) {}
  std::size_t read(std::span<std::byte> to) override;
  bool skip(std::uint64_t count) override;
  bool skip_rest() { return skip(left_); }
  std::uint64_t left() const { return left_; }

 private:
  Bytes& of_;
  std::uint64_t left_;
};

enum class Compression { lz4, zstd };

// Decompressed bytes of another object, which must outlive it.
class Decompressed final : public Bytes {
 public:
  Decompressed(Bytes& from, Compression);
  std::size_t read(std::span<std::byte> to) override;
  const std::string& error() const { return error_; }  // empty: none

 private:
  static std::ptrdiff_t feed(archive*, void* self, const void** bytes);
  struct Free {
    void operator()(archive*) const;
  };
  Bytes& from_;
  std::unique_ptr<std::byte[]> buffer_;
  std::unique_ptr<archive, Free> archive_;
  bool has_ended_ = false;
  std::string error_;
};

}  // namespace ontime::bag

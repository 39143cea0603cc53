// SPDX-License-Identifier: Apache-2.0
#include "lab/results.hpp"

#include <array>
#include <cerrno>
#include <fstream>
#include <system_error>

#include <fmt/format.h>

#include "lab/lab.hpp"

namespace ontime::lab {
namespace {

namespace fs = std::filesystem;

using Length = std::array<unsigned char, 8>;

Error cannot_be_written(const fs::path& file) {
  return Error(
      fmt::format("{} cannot be written: {}", file.string(), std::generic_category().message(errno)));
}

void copy(std::istream& from, std::uint64_t bytes, std::ostream& to) {
  std::array<char, 65536> part;
  while (bytes > 0 && to) {
    const auto next = std::min<std::uint64_t>(bytes, part.size());
    from.read(part.data(), static_cast<std::streamsize>(next));
    to.write(part.data(), from.gcount());
    bytes -= next;
  }
  to.flush();
}

}  // namespace

void send(const fs::path& results, const fs::path& out) {
  const auto bytes = fs::file_size(results);
  Length length{};
  for (std::size_t i = 0; i < length.size(); ++i) length.at(i) = static_cast<unsigned char>(bytes >> (8 * i));
  std::ifstream from(results, std::ios::binary);
  std::ofstream to(out, std::ios::binary | std::ios::app);
  to.write(reinterpret_cast<const char*>(length.data()), length.size());
  copy(from, bytes, to);
  if (!to) throw cannot_be_written(out);
}

bool Arrivals::next(const fs::path& into) {
  std::error_code none;
  const auto size = fs::file_size(file_, none);
  Length length{};
  if (none || size < taken_ + length.size()) return false;
  std::ifstream from(file_, std::ios::binary);
  from.seekg(static_cast<std::streamoff>(taken_));
  from.read(reinterpret_cast<char*>(length.data()), length.size());
  std::uint64_t bytes = 0;
  for (std::size_t i = 0; i < length.size(); ++i) bytes |= std::uint64_t{length.at(i)} << (8 * i);
  if (size - taken_ - length.size() < bytes) return false;
  std::ofstream to(into, std::ios::binary | std::ios::trunc);
  copy(from, bytes, to);
  if (!to) throw cannot_be_written(into);
  taken_ += length.size() + bytes;
  return true;
}

}  // namespace ontime::lab

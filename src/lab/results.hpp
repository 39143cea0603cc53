// SPDX-License-Identifier: Apache-2.0
// The runs that leave the machine, one after the other, while it goes on.
#pragma once

#include <cstdint>
#include <filesystem>

namespace ontime::lab {

// The machine's side. Adds a results file to `out`, its length before it: 8 bytes, the least first. Throws
// Error.
void send(const std::filesystem::path& results, const std::filesystem::path& out);

// This side, of a file that grows.
class Arrivals {
 public:
  explicit Arrivals(std::filesystem::path file) : file_(std::move(file)) {}
  // Writes the next results file to `into`, once it is whole; false: it is not yet. Throws Error if it cannot
  // be written.
  bool next(const std::filesystem::path& into);

 private:
  std::filesystem::path file_;
  std::uint64_t taken_ = 0;  // bytes
};

}  // namespace ontime::lab

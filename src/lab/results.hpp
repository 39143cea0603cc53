// SPDX-License-Identifier: Apache-2.0
// Sends runs out of the machine, one by one, while it runs.
#pragma once

#include <cstdint>
#include <filesystem>

namespace ontime::lab {

// The machine's side. Appends a results file to `out`, after its length: 8 bytes, little-endian. Throws
// Error.
void send(const std::filesystem::path& results, const std::filesystem::path& out);

// This side: reads a growing file.
class Arrivals {
 public:
  explicit Arrivals(std::filesystem::path file) : file_(std::move(file)) {}
  // Writes the next results file to `into` if it is complete; false: not yet. Throws Error if it cannot be
  // written.
  bool next(const std::filesystem::path& into);

 private:
  std::filesystem::path file_;
  std::uint64_t taken_ = 0;  // bytes
};

}  // namespace ontime::lab

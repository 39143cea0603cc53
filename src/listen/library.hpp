// SPDX-License-Identifier: Apache-2.0
// A shared library as a file: where its functions are, and where a probe in them costs least.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace ontime::listen {

// Where to set a probe, as an offset in the file. The kernel emulates the instruction of a cheap place (0.6
// µs a hit) and single-steps any other (10 µs).
struct Place {
  std::uint64_t offset = 0;
  bool is_cheap = false;
};

class Library {
 public:
  // Reads the file's symbols; throws Error when it is not a 64-bit ELF file of this machine's architecture.
  explicit Library(const std::string& path);

  // The first cheap place that every call passes once, with its first four arguments still in their registers
  // and its return address on top of the stack; without one, or where not all
  // jumps of the function are known, its first byte, as on other architectures than x86-64. Empty: the
  // library does not export the function.
  std::optional<Place> place(const std::string& function) const;
  // Cyclone DDS: where a topic's structure holds the pointer to its name, which is the size of an entity too;
  // found in the code of dds_get_name(). Empty: this library's code has another form.
  std::optional<std::uint64_t> offset_of_topic_name() const;

 private:
  struct Function {
    std::string name;
    std::uint64_t address = 0, offset = 0;
    std::vector<std::uint8_t> code;
    bool is_whole = false;  // code is all of it
  };
  const Function* find(const std::string& function) const;
  std::vector<Function> functions_;  // only those that a sensor may ask for
};

}  // namespace ontime::listen

// SPDX-License-Identifier: Apache-2.0
// A shared library as a file: where its functions are, and the cheapest places for probes in them.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "listen/code.hpp"

namespace ontime::listen {

// Where to set a probe, as an offset in the file.
struct Place {
  std::uint64_t offset = 0;
  bool is_cheap = false;  // the kernel emulates the instruction there
  Registers registers;    // of an entry: where the requested arguments are
};

class Library {
 public:
  using Names = std::set<std::string, std::less<>>;
  // Reads these functions, as far as the library exports them. Throws Error when it is not a 64-bit ELF file
  // of this machine's architecture.
  Library(const std::string& path, const Names& functions);

  // Of a function: a place for a probe on its calls, and one for a probe on its return (code.hpp). Empty: the
  // library does not export the function.
  std::optional<Place> entry(const std::string& function, std::span<const std::size_t> arguments) const;
  std::optional<Place> exit(const std::string& function) const;
  // As long as this lives; no bytes: the library does not export the function.
  Code code(const std::string& function) const;

 private:
  struct Function {
    std::uint64_t address = 0, offset = 0;
    std::vector<std::uint8_t> bytes;
    bool is_whole = false;           // these are all of it
    std::uint64_t cheap_callee = 0;  // offset in the file of exit_of()'s, where it begins cheaply
    Code code() const { return {bytes, address, is_whole}; }
  };
  const Function* find(const std::string& function) const;
  std::map<std::string, Function> functions_;
};

}  // namespace ontime::listen

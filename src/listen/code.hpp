// SPDX-License-Identifier: Apache-2.0
// The machine code of a function: the cheapest place for a probe, and where the function's arguments are at
// that place. The kernel emulates some instructions (0.6 µs a hit) and single-steps the others (10 µs). Pure.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>

namespace ontime::listen {

struct Code {
  std::span<const std::uint8_t> bytes;
  std::uint64_t address = 0;
  bool is_whole = false;  // the bytes are all of the function
};

// The register of each of the first four arguments, as event.h numbers them; 0: unknown.
using Registers = std::array<std::uint8_t, 4>;

struct Entry {
  std::uint64_t offset = 0;  // from the function's first byte
  bool is_cheap = false;
  Registers registers;
};
// The first cheap place that every call passes once and where these arguments (0 … 3) are in registers.
// Without one, where not all jumps of the function are known, or on other architectures than x86-64: its
// first byte.
Entry entry_of(const Code&, std::span<const std::size_t> arguments);

struct Exit {
  std::uint64_t offset = 0;  // from the function's first byte
  bool is_cheap = false;
  // The address of a function that begins with a cheap place and that each call of this one calls once, with
  // a result that is this one's.
  std::optional<std::uint64_t> callee;
};
// Where a probe on the return is set: a place that every call passes once, with the return address on top of
// the stack.
Exit exit_of(const Code&);
// The kernel emulates the instruction at the first byte.
bool begins_cheaply(const Code&);

// Cyclone DDS: where a topic's structure holds the pointer to its name, which is the size of an entity too;
// found in the code of dds_get_name(). Empty: the code has another form.
std::optional<std::uint64_t> offset_of_topic_name(const Code&);
// Of a function that does nothing but return a member of its object, or call a function of it: where in the
// object the member is. Empty: the code has another form.
std::optional<std::uint64_t> offset_of_member(const Code&);

}  // namespace ontime::listen

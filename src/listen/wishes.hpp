// SPDX-License-Identifier: Apache-2.0
// Which functions of a middleware are probed for its messages, by which programs (probes.bpf.c), and which of
// their arguments these need.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

struct bpf_program;
struct probes_bpf;

namespace ontime::listen {

// A function to probe: the BPF programs at its call and at its return (nullptr: none), the positions of the
// arguments that they need (none: it has no such argument), and further bits of the cookie.
struct Wish {
  static constexpr std::size_t none = SIZE_MAX;
  std::string function;
  bpf_program *on_call, *on_return = nullptr;
  struct {
    std::size_t endpoint = 0, taken = none, info = none;
  } arguments{};
  std::uint64_t cookie = 0;
  std::string returns_by{};  // the function that it ends with, where a probe on its return is better set
};

struct Wishes {
  std::vector<Wish> messages;
  std::vector<std::string> turns;  // functions that are called where a callback has ended
  bool knows_topics = true;        // false: the library has an unknown form
};
Wishes rcl_wishes();
Wishes rmw_wishes(const probes_bpf&);
Wishes cyclonedds_wishes(const probes_bpf&);
// By the library's file. Empty: not Fast DDS 2. An unreadable file counts as Fast DDS 2.
std::optional<Wishes> fastdds_wishes(const probes_bpf&, const std::string& path);

}  // namespace ontime::listen

// SPDX-License-Identifier: Apache-2.0
// The XDP program at the link: it hands a run's own frames to a socket, and all else on to the kernel.
#pragma once

#include <cstdint>

#include "transport/frames.hpp"

namespace ontime::transport::xdp {

// Held by descriptors alone, so that the kernel takes it off however the process ends.
class Program {
 public:
  // Throws Error for a program that is there already, which is left alone. Takes nothing.
  static void refuse_another(const frames::Link& link);
  // Of frames of that topic that come to that queue, to be received by `socket`. Native where the driver can,
  // else generic. Throws Error: no permission, no XDP, a program that came meanwhile.
  Program(const frames::Link& link, std::uint64_t topic, std::uint32_t queue, int socket);
  ~Program();
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;

  const char* mode() const noexcept { return mode_; }  // "native", "generic"

 private:
  void attach(const frames::Link& link);
  void close_all() noexcept;

  int map_ = -1, program_ = -1, attached_ = -1;
  const char* mode_ = "";
};

// What permissions are missing, for people.
extern const char* const wants_permission;

}  // namespace ontime::transport::xdp

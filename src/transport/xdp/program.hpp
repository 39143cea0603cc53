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

  const char* mode() const noexcept { return mode_; }  // "native", "generic"

 private:
  void attach(const frames::Link& link);

  Descriptor map_, program_, attached_;
  const char* mode_ = "";
};

// What permissions are missing, for people.
inline constexpr const char* wants_permission =
    "run as root, or start it with CAP_NET_RAW, CAP_NET_ADMIN and CAP_BPF: sudo setpriv --reuid=$USER "
    "--regid=$(id -g) --init-groups --inh-caps=+net_raw,+net_admin,+bpf "
    "--ambient-caps=+net_raw,+net_admin,+bpf ontime ...";

}  // namespace ontime::transport::xdp

// SPDX-License-Identifier: Apache-2.0
// The XDP program at the link: it passes the run's own frames to a socket, and all others to the kernel.
#pragma once

#include <cstdint>

#include "transport/frames.hpp"

namespace ontime::transport::xdp {

// Only descriptors hold it, so the kernel removes it however the process ends.
class Program {
 public:
  // Throws Error if the link already has a program, which stays. Attaches nothing.
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

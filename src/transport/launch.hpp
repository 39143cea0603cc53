// SPDX-License-Identifier: Apache-2.0
// Sockets whose messages say when they are to leave (SO_TXTIME), for the queueing discipline etf, which goes
// by CLOCK_TAI alone. What has no etf before it leaves at once, whatever it says.
#pragma once

#include <array>
#include <cerrno>
#include <cstring>
#include <limits>
#include <span>
#include <string>
#include <system_error>

#include <linux/net_tstamp.h>
#include <sys/socket.h>

#include "transport/clock.hpp"
#include "transport/transport.hpp"

namespace ontime::transport {

inline void permit_launch_times(int fd) {
  const sock_txtime by{.clockid = CLOCK_TAI, .flags = 0};
  if (setsockopt(fd, SOL_SOCKET, SO_TXTIME, &by, sizeof by) == 0) return;
  if (errno == EPERM)
    throw Error(
        "launch-time: this process may not say when what it sends is to leave: run it as root, or grant it "
        "CAP_NET_ADMIN");
  throw Error("launch-time: this kernel has no SO_TXTIME (Linux has, from 4.19 on): " +
              std::generic_category().message(errno));
}

// What CLOCK_TAI will show when now_ns() is that. It is set together with the wall clock, so it is asked each
// time; of several answers the one that took least is the surest. Whether the kernel knows what TAI is ahead
// of UTC does not matter: etf reads the same clock.
inline std::int64_t tai_of(std::int64_t monotonic_ns) noexcept {
  std::int64_t ahead_ns = 0, least_ns = std::numeric_limits<std::int64_t>::max();
  for (int attempt = 0; attempt < 3; ++attempt) {
    timespec tai{};
    const auto before_ns = now_ns();
    clock_gettime(CLOCK_TAI, &tai);
    const auto took_ns = now_ns() - before_ns;
    if (took_ns >= least_ns) continue;
    least_ns = took_ns;
    ahead_ns = std::int64_t{tai.tv_sec} * 1'000'000'000 + tai.tv_nsec - before_ns - took_ns / 2;
  }
  return monotonic_ns + ahead_ns;
}

// sendto(), of what is to leave at that time. Real-time. Not inline: its buffers are not to be on the stack
// of who sends without.
[[gnu::noinline]] inline ssize_t send_to_leave_at(std::int64_t at_ns, int fd,
                                                  std::span<const std::byte> bytes,
                                                  const sockaddr* to = nullptr,
                                                  socklen_t to_bytes = 0) noexcept {
  iovec part{const_cast<std::byte*>(bytes.data()), bytes.size()};
  alignas(cmsghdr) std::array<char, CMSG_SPACE(sizeof(std::uint64_t))> control{};
  msghdr message{};
  message.msg_name = const_cast<sockaddr*>(to);
  message.msg_namelen = to_bytes;
  message.msg_iov = &part;
  message.msg_iovlen = 1;
  message.msg_control = control.data();
  message.msg_controllen = control.size();
  auto* const head = CMSG_FIRSTHDR(&message);
  head->cmsg_level = SOL_SOCKET;
  head->cmsg_type = SCM_TXTIME;
  head->cmsg_len = CMSG_LEN(sizeof(std::uint64_t));
  const auto tai_ns = static_cast<std::uint64_t>(tai_of(at_ns));
  std::memcpy(CMSG_DATA(head), &tai_ns, sizeof tai_ns);
  return sendmsg(fd, &message, MSG_NOSIGNAL | MSG_DONTWAIT);  // what waits for its launch may fill the socket
}

}  // namespace ontime::transport

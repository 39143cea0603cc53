// SPDX-License-Identifier: Apache-2.0
// What transports need from the kernel: descriptors, addresses, links, launch times.
#pragma once

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstdint>
#include <cstring>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <system_error>
#include <thread>
#include <utility>

#include <arpa/inet.h>
#include <linux/close_range.h>
#include <linux/net_tstamp.h>
#include <net/if.h>
#include <netdb.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/utsname.h>
#include <unistd.h>

#include "transport/clock.hpp"
#include "transport/transport.hpp"

namespace ontime::transport {

// Owns a file descriptor; below 0: none.
class Descriptor {
 public:
  explicit Descriptor(int fd = -1) noexcept : fd_(fd) {}
  ~Descriptor() {
    if (fd_ >= 0) close(fd_);
  }
  Descriptor(Descriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  Descriptor& operator=(Descriptor&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  operator int() const noexcept { return fd_; }  // NOLINT(google-explicit-constructor)

 private:
  int fd_;
};

inline std::string errno_text() { return std::generic_category().message(errno); }

inline std::string kernel_version() {
  utsname name{};
  uname(&name);
  return std::string("Linux ") + name.release;
}

// Gives this thread a separate table of file descriptors with only these two in it: a table that
// threads share costs two atomic operations a call. False if the kernel refuses.
inline bool keep_alone(int one, int other) noexcept {
  const auto low = static_cast<unsigned>(std::min(one, other));
  const auto high = static_cast<unsigned>(std::max(one, other));
  if (close_range(high + 1, ~0U, CLOSE_RANGE_UNSHARE) != 0) return false;
  if (low > 0) close_range(0, low - 1, 0);
  if (high > low + 1) close_range(low + 1, high - 1, 0);
  return true;
}

// The first IPv4 address of a host. Returns 0, or an error for gai_strerror().
inline int look_up(const std::string& host, in_addr& address) {
  addrinfo hints{};
  hints.ai_family = AF_INET;
  hints.ai_socktype = SOCK_DGRAM;
  addrinfo* found = nullptr;
  const int error = getaddrinfo(host.c_str(), nullptr, &hints, &found);
  if (error != 0) return error;
  address = reinterpret_cast<const sockaddr_in*>(found->ai_addr)->sin_addr;
  freeaddrinfo(found);
  return 0;
}

inline std::string text_of(in_addr address) {
  char text[INET_ADDRSTRLEN] = {};
  inet_ntop(AF_INET, &address, text, sizeof text);
  return text;
}

// Throws Error if the link does not run. `flags()` returns the kernel's present flags (IFF_UP and others), or
// nothing if no such link exists; `which` then completes the error. The kernel reports a new link as running
// up to several seconds late, so this waits for a link that is up.
template <typename Flags>
void await_running(const Flags& flags, const std::string& who, const std::string& interface,
                   const std::string& which) {
  const std::int64_t end_ns = now_ns() + 10'000'000'000;
  std::optional<unsigned> now;
  while ((now = flags()) && (*now & IFF_UP) != 0) {
    if ((*now & IFF_RUNNING) != 0) return;
    if (now_ns() > end_ns) break;
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  if (!now) throw Error(who + ": this host has no interface " + interface + which);
  throw Error(who + ": interface " + interface + " is down or has no carrier (see ip link)");
}

// Enables launch times (SO_TXTIME) on the socket, for the queueing discipline etf, which uses CLOCK_TAI only.
// Without etf a packet leaves at once, whatever its launch time.
inline void permit_launch_times(int fd) {
  const sock_txtime by{.clockid = CLOCK_TAI, .flags = 0};
  if (setsockopt(fd, SOL_SOCKET, SO_TXTIME, &by, sizeof by) == 0) return;
  if (errno == EPERM)
    throw Error(
        "launch-time: this process may not set launch times of packets (SO_TXTIME). Fix: run as root, or "
        "grant CAP_NET_ADMIN");
  throw Error("launch-time: this kernel has no SO_TXTIME (needs Linux 4.19): " + errno_text());
}

// The time of CLOCK_TAI when now_ns() has that value. It changes with the wall clock, so it is read each
// time; of several readings the fastest is the most accurate. The kernel need not know the offset of TAI to
// UTC: etf reads the same clock.
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

// sendto() with a launch time. Real-time. Not inline, so that sending without one needs no stack for its
// buffers.
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
  return sendmsg(fd, &message, MSG_NOSIGNAL | MSG_DONTWAIT);  // waiting packets may fill the socket
}

}  // namespace ontime::transport

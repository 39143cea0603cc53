// SPDX-License-Identifier: Apache-2.0
// What transports ask of the kernel by themselves: descriptors, addresses, links.
#pragma once

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <system_error>
#include <thread>
#include <utility>

#include <arpa/inet.h>
#include <linux/close_range.h>
#include <net/if.h>
#include <netdb.h>
#include <netinet/in.h>
#include <sys/utsname.h>
#include <unistd.h>

#include "transport/clock.hpp"
#include "transport/transport.hpp"

namespace ontime::transport {

// A file descriptor that is closed with this; below 0: none.
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

// Gives this thread a table of file descriptors of its own with nothing but these two in it: a table that
// threads share costs two atomic operations a call. False if the kernel does not.
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

// Throws Error where the link does not run. `flags()` is what the kernel says of it now (IFF_UP and others),
// or nothing if it is not there, as `which` then says. The kernel tells a second late that a new link runs,
// and on a busy machine several, so for one that is up this waits.
template <typename Flags>
void await_running(const Flags& flags, const std::string& who, const std::string& interface,
                   const std::string& which) {
  const std::int64_t end_ns = now_ns() + 10'000'000'000;
  while (true) {
    const std::optional<unsigned> now = flags();
    if (!now) throw Error(who + ": this host has no interface " + interface + which);
    const bool up = (*now & IFF_UP) != 0;
    if (up && (*now & IFF_RUNNING) != 0) return;
    if (!up || now_ns() > end_ns)
      throw Error(who + ": the interface " + interface + " is down or has no carrier; see \"ip link\"");
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
}

}  // namespace ontime::transport

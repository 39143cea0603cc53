// SPDX-License-Identifier: Apache-2.0
// For programs that qemu-user runs, and of no use elsewhere: qemu-user knows no IP_MULTICAST_IF, and DDS
// libraries give up without it. Multicast messages then leave by the interface that the routes name.
#include <cerrno>

#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>

extern "C" [[gnu::visibility("default")]] int setsockopt(int fd, int level, int name, const void* value,
                                                         socklen_t bytes) noexcept {
  const long result = syscall(SYS_setsockopt, fd, level, name, value, bytes);
  const bool is_lacking =
      result != 0 && errno == ENOPROTOOPT && level == IPPROTO_IP && name == IP_MULTICAST_IF;
  return is_lacking ? 0 : static_cast<int>(result);
}

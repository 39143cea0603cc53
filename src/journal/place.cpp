// SPDX-License-Identifier: Apache-2.0
#include "journal/place.hpp"

#include <cerrno>
#include <cstdint>
#include <thread>

#include <asm/socket.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <glob.h>
#include <linux/magic.h>
#include <sched.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/vfs.h>

#include "journal/folder.hpp"

namespace ontime::journal {
namespace {

// Of this thread's network namespace; 0 if the kernel has none, or lets this process ask for none. `error`:
// an errno if it cannot be known now.
std::uint64_t cookie(int& error) {
  std::uint64_t cookie = 0;
#ifdef SO_NETNS_COOKIE
  const Fd any(socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  if (any.get() < 0 && (errno == EMFILE || errno == ENFILE || errno == ENOMEM || errno == ENOBUFS))
    error = errno;
  socklen_t bytes = sizeof cookie;
  if (any.get() < 0 || getsockopt(any.get(), SOL_SOCKET, SO_NETNS_COOKIE, &cookie, &bytes) != 0) return 0;
#endif
  return cookie;
}

std::string mount_identity(const struct stat& found) {
  return fmt::format("{}:{}", found.st_dev, found.st_ino);
}

}  // namespace

std::string boot_id() {
  return process::word(process::text_of("/proc/sys/kernel/random/boot_id")).value_or("");
}

std::string network_identity(int fd) {
  struct stat found {};
  struct statfs files {};
  if (fstat(fd, &found) != 0 || fstatfs(fd, &files) != 0 || files.f_type != NSFS_MAGIC) return "";
  bool is_network = true;
  std::uint64_t number = 0;
  int error = 0;
  // The kernel refuses a namespace of another kind (EINVAL) before it asks whether the caller may enter.
  // qemu-user lacks the ioctl that would tell the kind.
  std::thread([&] {
    if (setns(fd, CLONE_NEWNET) == 0)
      number = cookie(error);
    else
      is_network = errno != EINVAL;
  }).join();
  if (!is_network) return "";
  if (error != 0) throw cannot("/proc/self/ns/net", error);
  return fmt::format("{}:{}:{}", found.st_dev, found.st_ino, number);
}

std::string place(Scope scope) {
  if (scope == Scope::machine) return "";
  const bool network = scope == Scope::network_namespace;
  const char* const path = network ? "/proc/thread-self/ns/net" : "/proc/thread-self/ns/mnt";
  const Fd own(open(path, O_RDONLY | O_CLOEXEC));
  struct stat found {};
  if (own.get() < 0 || fstat(own.get(), &found) != 0) throw cannot(path, errno);
  return network ? network_identity(own.get()) : mount_identity(found);
}

bool mount_namespace_ended(const std::string& place) {
  constexpr ino_t first_pid_namespace = 0xEFFFFFFCU;  // PROC_PID_INIT_INO of the kernel: sees all processes
  struct stat found {};
  if (geteuid() != 0 || stat("/proc/self/ns/pid", &found) != 0 || found.st_ino != first_pid_namespace)
    return false;
  // A /proc may hide processes with more rights than the caller's (hidepid): then those of the kernel, too.
  if (stat("/proc/2/ns/mnt", &found) != 0) return false;
  const auto mounts = process::text_of("/proc/self/mountinfo").value_or("");
  if (mounts.empty() ||
      mounts.find(fmt::format("mnt:[{}]", place.substr(place.find(':') + 1))) != mounts.npos)
    return false;
  glob_t threads{};
  // But process 1, which may not be looked at: it is where the kernel's threads are.
  // NOLINTNEXTLINE(concurrency-mt-unsafe): only a ~ would be
  bool ended = glob("/proc/[0-9]*/task/[0-9]*", GLOB_NOSORT, nullptr, &threads) == 0;
  for (std::size_t i = 0; ended && i < threads.gl_pathc; ++i) {
    const auto path = fmt::format("{}/ns/mnt", threads.gl_pathv[i]);
    const bool known = stat(path.c_str(), &found) == 0;
    ended = known ? mount_identity(found) != place
                  : errno == ENOENT || errno == ESRCH || path.starts_with("/proc/1/");
  }
  globfree(&threads);
  return ended;
}

}  // namespace ontime::journal

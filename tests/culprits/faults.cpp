// SPDX-License-Identifier: Apache-2.0
// Preloaded into both ends of a run by tests/culprits/culprits: what the receiving thread of one of them does
// wrong with every so many-th message. ONTIME_CULPRIT is "FAULT INTERFACE EVERY MILLISECONDS FILE": FAULT is
// a word below, INTERFACE one that only this end has, FILE on a disk.
#include <atomic>
#include <cstdlib>
#include <ctime>
#include <mutex>
#include <sstream>
#include <string>
#include <thread>

#include <dlfcn.h>
#include <fcntl.h>
#include <net/if.h>
#include <pthread.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

namespace {

constexpr ssize_t message_bytes = 500;
constexpr ssize_t others_bytes = 100;  // what tests/culprits/culprits sends beside
constexpr long page_bytes = 4096;
std::mutex held;

std::int64_t now_ns() {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  return std::int64_t{now.tv_sec} * 1'000'000'000 + now.tv_nsec;
}
void sleep_ms(long ms) {
  const timespec pause{ms / 1000, ms % 1000 * 1'000'000};
  nanosleep(&pause, nullptr);
}

struct Fault {
  std::string what, interface, file;
  unsigned every = 0;
  long ms = 0;
  Fault() {
    if (const char* said = std::getenv("ONTIME_CULPRIT"))
      std::istringstream(said) >> what >> interface >> every >> ms >> file;
    if (every == 0 || if_nametoindex(interface.c_str()) == 0) what.clear();
    if (what == "lock" || what == "inversion") std::thread([this] { hold(); }).detach();
  }
  [[noreturn]] void hold() const {
    pthread_setname_np(pthread_self(), "culprit-lock");
    while (true) {
      sleep_ms(what == "lock" ? 10L * every : every);
      const std::lock_guard lock(held);
      if (what == "lock")
        sleep_ms(ms);
      else
        compute(4);  // shorter than any deadline: late is only who waits while it is kept from its CPU
    }
  }
  // For so long of its own, not counting what it waits for its CPU.
  static void compute(long ms) {
    const auto now_ns = [] {
      timespec now{};
      clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
      return std::int64_t{now.tv_sec} * 1'000'000'000 + now.tv_nsec;
    };
    for (const auto until_ns = now_ns() + ms * 1'000'000; now_ns() < until_ns;) {
    }
  }
  // Pages of a file that is in no cache, each once, until the time has passed.
  void touch_pages() const {
    static const auto pages = mapped();
    static long next = 0;
    constexpr long apart = 16;  // or one fault would map several
    const auto until_ns = now_ns() + ms * 1'000'000;
    for (const auto strides = pages.count / apart; next < pages.count && now_ns() < until_ns; ++next)
      static_cast<void>(pages.first[(next % strides * apart + next / strides) * page_bytes]);
  }
  struct Pages {
    const volatile char* first = nullptr;
    long count = 0;
  };
  Pages mapped() const {
    const int fd = open(file.c_str(), O_RDONLY | O_CLOEXEC);
    struct stat found {};
    if (fd < 0 || fstat(fd, &found) != 0) return {};
    const auto bytes = static_cast<std::size_t>(found.st_size);
    void* const all = mmap(nullptr, bytes, PROT_READ, MAP_PRIVATE, fd, 0);
    close(fd);
    if (all == MAP_FAILED) return {};
    madvise(all, bytes, MADV_RANDOM);
    return {static_cast<const char*>(all), found.st_size / page_bytes};
  }
  // With others' packets, of which there are more than it can take then.
  void be_slow() const {
    if (what == "buffer") sleep_ms(2);
  }
  void make(int socket) const {
    if (what == "lock" || what == "inversion") {
      const std::lock_guard lock(held);
      return;
    }
    if (what == "buffer") {
      const int least = 1;
      setsockopt(socket, SOL_SOCKET, SO_RCVBUF, &least, sizeof least);
      return;
    }
    static std::atomic<unsigned> messages{0};
    if (++messages % every != 0) return;
    if (what == "sleep") sleep_ms(ms);
    if (what == "pages") touch_pages();
    if (what == "busy")
      for (const auto until_ns = now_ns() + ms * 1'000'000; now_ns() < until_ns;) {
      }
  }
};

bool is_of_the_link(int socket) {
  int domain = 0, type = 0;
  socklen_t size = sizeof domain;
  return getsockopt(socket, SOL_SOCKET, SO_DOMAIN, &domain, &size) == 0 && domain == AF_INET &&
         getsockopt(socket, SOL_SOCKET, SO_TYPE, &type, &size) == 0 && type == SOCK_DGRAM;
}

ssize_t after(int socket, ssize_t bytes) {
  if ((bytes < message_bytes && bytes != others_bytes) || !is_of_the_link(socket)) return bytes;
  static const Fault fault;
  if (bytes == others_bytes)
    fault.be_slow();
  else if (!fault.what.empty())
    fault.make(socket);
  return bytes;
}

template <class Function>
Function next(Function, const char* name) {
  return reinterpret_cast<Function>(dlsym(RTLD_NEXT, name));
}

}  // namespace

extern "C" {
ssize_t recv(int socket, void* bytes, size_t size, int flags) {
  static const auto real = next(&recv, "recv");
  return after(socket, real(socket, bytes, size, flags));
}
ssize_t recvfrom(int socket, void* bytes, size_t size, int flags, sockaddr* from, socklen_t* from_size) {
  static const auto real = next(&recvfrom, "recvfrom");
  return after(socket, real(socket, bytes, size, flags, from, from_size));
}
ssize_t recvmsg(int socket, msghdr* message, int flags) {
  static const auto real = next(&recvmsg, "recvmsg");
  return after(socket, real(socket, message, flags));
}
}

// SPDX-License-Identifier: Apache-2.0
#include "two_ends.hpp"

#include <cerrno>
#include <chrono>
#include <exception>
#include <filesystem>
#include <system_error>

#include <dlfcn.h>
#include <fcntl.h>
#include <net/if.h>
#include <sched.h>
#include <signal.h>
#include <sys/ioctl.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

namespace ontime::two_ends {

using namespace std::chrono_literals;
using transport::Error;

const transport::Plugin& plugin() {
  const auto program = std::filesystem::read_symlink("/proc/self/exe");
  const auto file = program.parent_path().parent_path() / "ontime/ontime_transport_ros2.so";
  void* const object = dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE);
  if (object == nullptr) throw Error(dlerror());  // NOLINT(concurrency-mt-unsafe)
  return *static_cast<const transport::Plugin*>(dlsym(object, "ontime_transport"));
}

bool isolate() {
  if (unshare(CLONE_NEWNET) != 0 && unshare(CLONE_NEWUSER | CLONE_NEWNET) != 0) return false;
  return set_loopback(IFF_UP, true);
}

bool set_loopback(int flag, bool on) {
  const int socket = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  ifreq request{};
  std::string("lo").copy(request.ifr_name, IFNAMSIZ - 1);
  ioctl(socket, SIOCGIFFLAGS, &request);
  request.ifr_flags = static_cast<short>(on ? request.ifr_flags | flag : request.ifr_flags & ~flag);
  const bool done = ioctl(socket, SIOCSIFFLAGS, &request) == 0;
  close(socket);
  return done;
}

Child::Child(const std::function<void(int, int)>& run) {
  int to[2];
  int from[2];
  if (pipe2(to, O_CLOEXEC) != 0 || pipe2(from, O_CLOEXEC) != 0)
    throw std::system_error(errno, std::system_category(), "pipe");
  pid_ = fork();
  if (pid_ == 0) {
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    close(to[1]);
    close(from[0]);
    int status = 0;
    try {
      run(to[0], from[1]);
    } catch (const std::exception& error) {
      const std::string text = error.what();
      status = write(from[1], text.data(), text.size()) < 0 ? 2 : 1;
    }
    _exit(status);
  }
  close(to[0]);
  close(from[1]);
  to_ = to[1];
  from_ = from[0];
}

Child::~Child() {
  finish();
  close(from_);
}

std::string Child::result() {
  std::string text;
  char bytes[4096];
  for (ssize_t n = 0; (n = read(from_, bytes, sizeof bytes)) > 0;)
    text.append(bytes, static_cast<std::size_t>(n));
  return text;
}

std::string Child::result(std::size_t bytes) {
  std::string text(bytes, '\0');
  std::size_t done = 0;
  for (ssize_t n = 0; done < bytes && (n = read(from_, text.data() + done, bytes - done)) > 0;)
    done += static_cast<std::size_t>(n);
  text.resize(done);
  return text;
}

void Child::finish() {
  if (pid_ == 0) return;
  close(to_);
  waitpid(pid_, nullptr, 0);
  pid_ = 0;
}

void await_end(int end) {
  char nothing = 0;
  while (read(end, &nothing, 1) > 0) {
  }
}

Receiving::Receiving(transport::Endpoint& endpoint, transport::Receive receive) : endpoint_(endpoint) {
  if (receive == transport::Receive::waitset)
    thread_ = std::thread([this] {
      while (!ends_) endpoint_.receive();
    });
}

Receiving::~Receiving() {
  ends_ = true;
  endpoint_.interrupt();
  if (thread_.joinable()) thread_.join();
}

void serve(const transport::Config& config, int end) {
  Echo echo;
  const auto endpoint = plugin().open(config, echo);
  echo.endpoint = endpoint.get();
  const Receiving receiving(*endpoint, config.receive);
  await_end(end);
}

bool await_match(transport::Endpoint& endpoint) {
  for (int i = 0; i < 2000 && !endpoint.matched().both(); ++i) std::this_thread::sleep_for(5ms);
  return endpoint.matched().both();
}

}  // namespace ontime::two_ends

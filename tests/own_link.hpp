// SPDX-License-Identifier: Apache-2.0
// A link of a test's own: a veth pair, `near` (10.9.0.1) and `far` (10.9.0.2), in a network namespace of this
// thread and of those that it starts. Needs root.
#pragma once

#include <cstdlib>
#include <stdexcept>
#include <string>

#include <fcntl.h>
#include <sched.h>
#include <unistd.h>

namespace ontime {

class OwnLink {
 public:
  OwnLink() : before_(open("/proc/thread-self/ns/net", O_RDONLY | O_CLOEXEC)) {
    if (before_ < 0 || unshare(CLONE_NEWNET) != 0) throw std::runtime_error("no network namespace");
    ip("link add near type veth peer name far");
    ip("address add 10.9.0.1/24 dev near");
    ip("address add 10.9.0.2/24 dev far");
    for (const char* name : {"near", "far", "lo"}) ip(std::string("link set up dev ") + name);
  }
  ~OwnLink() {
    setns(before_, CLONE_NEWNET);
    close(before_);
  }
  OwnLink(const OwnLink&) = delete;
  OwnLink& operator=(const OwnLink&) = delete;

  static bool try_ip(const std::string& what) {
    return std::system(("ip " + what + " 2>/dev/null").c_str()) == 0;  // NOLINT(concurrency-mt-unsafe)
  }
  static void ip(const std::string& what) {
    if (!try_ip(what)) throw std::runtime_error("ip " + what);
  }

 private:
  int before_;
};

}  // namespace ontime

// SPDX-License-Identifier: Apache-2.0
// When an interface could carry nothing, as the kernel tells whoever listens: by a thread of its own,
// ordinary, so some time after it was so if that gets no CPU.
#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

struct mnl_socket;

namespace ontime::machine {

class LinkWatch {
 public:
  explicit LinkWatch(const std::string& interface);  // from now on; throws Error
  ~LinkWatch();
  LinkWatch(const LinkWatch&) = delete;
  LinkWatch& operator=(const LinkWatch&) = delete;

  struct Down {
    std::int64_t from_ns, to_ns;  // CLOCK_MONOTONIC; to_ns 0: still
    bool taken;                   // by somebody, or it is gone; false: it had no carrier
  };
  static constexpr std::size_t most = 100;  // that are kept, the first
  std::vector<Down> downs() const;

 private:
  void watch();

  const unsigned interface_;
  const std::unique_ptr<mnl_socket, int (*)(mnl_socket*)> socket_;
  const int over_;  // an eventfd
  mutable std::mutex mutex_;
  std::vector<Down> downs_;
  std::thread thread_;
};

}  // namespace ontime::machine

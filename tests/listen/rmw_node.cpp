// SPDX-License-Identifier: Apache-2.0
// A node over the stand-in for rmw: it publishes 1,000 messages a second until it is ended, and takes each.
// Of 100 one is never taken, and 10 come twice.
#include <csignal>

#include <unistd.h>

#include "rmw.hpp"

namespace {
volatile std::sig_atomic_t ended = 0;
}

int main() {
  std::signal(SIGTERM, [](int) { ended = 1; });
  rmw_fake_init();
  int with_duplicates = 0;
  // A copy, as each middleware makes: what no thread has touched is not in memory.
  const char topic[] = "/scan";
  const rmw_publisher publisher{"rmw_fake_cpp", &with_duplicates, topic};
  const rmw_subscription subscription{"rmw_fake_cpp", nullptr, topic};
  for (std::uint64_t number = 0; ended == 0; ++number) {
    rmw_publish(&publisher, &number, nullptr);
    for (int i = 0; i < (number % 10 == 9 ? 2 : 1); ++i) {
      std::uint64_t message = 0;
      bool taken = false;
      rmw_message_info info{};
      rmw_take_with_info(&subscription, &message, &taken, &info, nullptr);
    }
    usleep(1000);
  }
  return 0;
}

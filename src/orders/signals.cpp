// SPDX-License-Identifier: Apache-2.0
#include <csignal>

#include "orders/orders.hpp"

namespace ontime::orders {

void on_termination(void (*handler)(int)) {
  sigset_t handled;
  sigemptyset(&handled);
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) {
    struct sigaction now {};
    sigaction(signal, nullptr, &now);
    if (now.sa_handler == SIG_IGN) continue;
    struct sigaction action {};
    action.sa_handler = handler;
    sigaction(signal, &action, nullptr);
    sigaddset(&handled, signal);
  }
  pthread_sigmask(SIG_UNBLOCK, &handled, nullptr);  // a thread with blocked signals may have started us
  std::signal(SIGPIPE, SIG_IGN);
}

static_assert(Interrupts::is_always_lock_free, "it is counted in a signal handler");

void count_termination(Interrupts& count, int signal) noexcept {
  int none = 0;
  if (signal == SIGINT)
    ++count;
  else
    count.compare_exchange_strong(none, 1);
}

}  // namespace ontime::orders

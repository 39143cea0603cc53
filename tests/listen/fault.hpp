// SPDX-License-Identifier: Apache-2.0
// What a node does wrong with every 30th message, for 25 ms, while tests/culprits/nodes tells it so: by the
// first byte of the file that LISTEN_NODE_FAULT names. The rest of that file is pages that are on a disk.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdlib>
#include <mutex>
#include <thread>

#include <fcntl.h>
#include <pthread.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

class Fault {
 public:
  Fault() {
    const char* const path =
        std::getenv("LISTEN_NODE_FAULT");  // NOLINT(concurrency-mt-unsafe): before any thread
    const int file = path == nullptr ? -1 : open(path, O_RDONLY | O_CLOEXEC);
    struct stat found {};
    if (file < 0 || fstat(file, &found) != 0) return;
    pages_ = found.st_size / page_bytes;
    void* const all = mmap(nullptr, static_cast<std::size_t>(found.st_size), PROT_READ, MAP_SHARED, file, 0);
    close(file);
    if (all == MAP_FAILED) return;
    madvise(all, static_cast<std::size_t>(found.st_size), MADV_RANDOM);
    first_ = static_cast<const volatile char*>(all);
    std::thread([this] { hold(); }).detach();
  }

  void make() {
    if (first_ == nullptr || ++messages_ % 30 != 0) return;
    switch (*first_) {
      case 's':
        std::this_thread::sleep_for(length);
        break;
      case 'b':
        compute();
        break;
      case 'p':
        touch_pages();
        break;
      case 'l': {
        is_wanted_ = true;
        while (is_wanted_) std::this_thread::yield();
        const std::lock_guard lock(mutex_);
      }
    }
  }

 private:
  static constexpr long page_bytes = 4096, apart = 16;  // closer together, one fault would map several
  static constexpr std::chrono::milliseconds length{25};

  static void compute() {
    for (const auto until = std::chrono::steady_clock::now() + length;
         std::chrono::steady_clock::now() < until;) {
    }
  }
  void touch_pages() {
    const auto until = std::chrono::steady_clock::now() + length;
    for (const auto strides = pages_ / apart; next_ < pages_ && std::chrono::steady_clock::now() < until;
         ++next_)
      static_cast<void>(first_[(next_ % strides * apart + next_ / strides) * page_bytes]);
  }
  // Another thread of the node's has the lock, and computes.
  [[noreturn]] void hold() {
    pthread_setname_np(pthread_self(), "culprit-lock");
    while (true) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
      if (!is_wanted_) continue;
      const std::lock_guard lock(mutex_);
      is_wanted_ = false;
      compute();
    }
  }

  const volatile char* first_ = nullptr;
  long pages_ = 0, next_ = 1;
  unsigned messages_ = 0;
  std::atomic<bool> is_wanted_ = false;
  std::mutex mutex_;
};

// SPDX-License-Identifier: Apache-2.0
// What the programs that `ontime listen` is held against have alike: they are told by signals, and keep their
// own account of each message.
#pragma once

#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <thread>
#include <vector>

#include <time.h>

#include "fault.hpp"

inline volatile std::sig_atomic_t ended = 0, begun = 0;  // by SIGTERM or SIGINT, by SIGUSR1

inline void catch_signals() {
  struct sigaction action {};
  action.sa_handler = [](int) { ended = 1; };
  sigaction(SIGTERM, &action, nullptr);
  sigaction(SIGINT, &action, nullptr);
  action.sa_handler = [](int) { begun = 1; };
  sigaction(SIGUSR1, &action, nullptr);
}

inline std::int64_t now_ns() {
  timespec time{};
  clock_gettime(CLOCK_MONOTONIC, &time);
  return std::int64_t{time.tv_sec} * 1'000'000'000 + time.tv_nsec;
}

struct Line {
  std::uint64_t number;
  std::int64_t at_ns, stamp_ns;
};

// Its number, CLOCK_MONOTONIC just before the write or just after the take, and for a take the source time
// stamp.
inline void write_log(const char* path, const std::vector<Line>& lines) {
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen(path, "w"), std::fclose);
  for (const auto& line : lines)
    std::fprintf(file.get(), "%llu %lld %lld\n", static_cast<unsigned long long>(line.number),
                 static_cast<long long>(line.at_ns), static_cast<long long>(line.stamp_ns));
}

// Begins at SIGUSR1, when a reader is matched. Every 997th message waits 30 ms more.
void publish_each(std::uint64_t count, std::chrono::microseconds period, std::vector<Line>& lines,
                  auto has_reader, auto write) {
  Fault fault;
  while (ended == 0 && (begun == 0 || !has_reader()))
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  lines.reserve(count);
  auto due = std::chrono::steady_clock::now();
  for (std::uint64_t number = 0; ended == 0 && number < count; ++number) {
    due += period;
    if (number % 997 == 996) due += std::chrono::milliseconds(30);
    std::this_thread::sleep_until(due);
    fault.make();
    lines.push_back({number, now_ns(), 0});
    write(number);
  }
}

// The first 200 as they come, then every `period` (0: as they come).
void take_each(std::chrono::microseconds period, const std::vector<Line>& lines, auto wait, auto take) {
  Fault fault;
  while (ended == 0) {
    if (period.count() == 0 || lines.size() < 200)
      wait();
    else
      std::this_thread::sleep_for(period);
    fault.make();
    take();
  }
}

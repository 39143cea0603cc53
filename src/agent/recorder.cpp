// SPDX-License-Identifier: Apache-2.0
#include "agent/recorder.hpp"

#include <algorithm>
#include <chrono>
#include <utility>

#include <pthread.h>
#include <sched.h>
#include <sys/resource.h>
#include <unistd.h>

namespace ontime::agent {
namespace {

using namespace std::chrono_literals;

constexpr auto look = 500ms;
constexpr int light = 10;             // of niceness, a tenth of an ordinary thread's weight
constexpr std::size_t at_once = 512;  // 40 kB: less than a pipe holds
constexpr std::size_t most_waiting_bytes = std::size_t{1} << 30;  // of a day and a half at 100 Hz

}  // namespace

Recorder::Recorder(roundtrip::Client& client, orders::Events& events, roundtrip::Schedule schedule,
                   Waiting waiting)
    : client_(client),
      events_(events),
      patience_(schedule == roundtrip::Schedule::back_to_back ? client.capacity() / 2 : 0),
      waiting_(waiting == Waiting::for_the_end ? std::tmpfile() : nullptr, std::fclose),
      thread_([this](const std::stop_token& stop) { record(stop); }) {
  equipped_.wait();
}

Recorder::~Recorder() { finish(); }

std::size_t Recorder::finish() {
  if (!thread_.joinable()) return waited_bytes_;
  thread_ = {};  // stops it and waits
  try {
    while (hand_over()) continue;
    hand_over_what_waited();
  } catch (const orders::Broken&) {  // the thread that reads orders notices it too
  }
  return waited_bytes_;
}

void Recorder::record(const std::stop_token& stop) {
  pthread_setname_np(pthread_self(), "ontime-record");
  // Not SCHED_IDLE: under a dozen hogs that would not run for seconds, and others wait for what it holds.
  const sched_param none{};
  sched_setscheduler(0, SCHED_BATCH, &none);
  const auto self = static_cast<id_t>(gettid());
  setpriority(PRIO_PROCESS, self, getpriority(PRIO_PROCESS, self) + light);
  // Here, not in the constructor: a thread's first allocation makes it an arena of the heap.
  batch_.resize(at_once);
  equipped_.count_down();
  std::unique_lock lock(mutex_);
  try {
    while (!wake_.wait_for(lock, stop, look, [&] { return stop.stop_requested(); })) {
      if (client_.undrained() <= patience_) continue;
      lock.unlock();
      while (!stop.stop_requested() && hand_over()) continue;
      lock.lock();
    }
  } catch (const orders::Broken&) {  // the thread that reads orders notices it too
  }
}

bool Recorder::hand_over() {
  const auto count = client_.drain(batch_);
  if (count == 0) return false;
  const std::span bytes{reinterpret_cast<const std::uint8_t*>(batch_.data()),
                        count * sizeof(roundtrip::Sample)};
  if (keep(bytes)) return true;
  hand_over_what_waited();  // first, so that the order stays
  events_.tell("samples", nlohmann::json::object(), bytes);
  return true;
}

bool Recorder::keep(std::span<const std::uint8_t> bytes) {
  if (!waiting_ || waited_bytes_ + bytes.size() > most_waiting_bytes) return false;
  // Ignores a partial write that a full disk left behind.
  const auto whole = static_cast<long>(waited_bytes_);
  if (std::fseek(waiting_.get(), whole, SEEK_SET) != 0 ||
      std::fwrite(bytes.data(), bytes.size(), 1, waiting_.get()) != 1 || std::fflush(waiting_.get()) != 0)
    return false;
  waited_bytes_ += bytes.size();
  return true;
}

void Recorder::hand_over_what_waited() {
  const auto file = std::exchange(waiting_, File(nullptr, std::fclose));
  if (!file) return;
  std::rewind(file.get());
  std::vector<std::uint8_t> bytes(at_once * sizeof(roundtrip::Sample));
  for (auto left = waited_bytes_; left > 0;) {
    const auto count = std::fread(bytes.data(), 1, std::min(left, bytes.size()), file.get());
    if (count == 0) return;
    events_.tell("samples", nlohmann::json::object(), {bytes.data(), count});
    left -= count;
  }
}

}  // namespace ontime::agent

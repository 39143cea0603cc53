// SPDX-License-Identifier: Apache-2.0
#include "agent/recorder.hpp"

#include <chrono>

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

}  // namespace

Recorder::Recorder(roundtrip::Client& client, orders::Events& events, roundtrip::Schedule schedule)
    : client_(client),
      events_(events),
      patience_(schedule == roundtrip::Schedule::back_to_back ? client.capacity() / 2 : 0),
      batch_(at_once),
      thread_([this] { record(); }) {}

Recorder::~Recorder() {
  {
    const std::lock_guard lock(mutex_);
    over_ = true;
  }
  wake_.notify_all();
  thread_.join();
  try {
    while (hand_over()) continue;
  } catch (const orders::Broken&) {  // whoever reads orders will find so
  }
}

void Recorder::record() {
  pthread_setname_np(pthread_self(), "ontime-record");
  // Not SCHED_IDLE: under a dozen hogs that would not run for seconds, and others wait for what it holds.
  const sched_param none{};
  sched_setscheduler(0, SCHED_BATCH, &none);
  const auto self = static_cast<id_t>(gettid());
  setpriority(PRIO_PROCESS, self, getpriority(PRIO_PROCESS, self) + light);
  std::unique_lock lock(mutex_);
  try {
    while (!wake_.wait_for(lock, look, [this] { return over_.load(); })) {
      if (client_.undrained() <= patience_) continue;
      lock.unlock();
      while (!over_ && hand_over()) continue;
      lock.lock();
    }
  } catch (const orders::Broken&) {  // whoever reads orders will find so
  }
}

bool Recorder::hand_over() {
  const auto count = client_.drain(batch_);
  if (count == 0) return false;
  events_.tell("samples", nlohmann::json::object(),
               {reinterpret_cast<const std::uint8_t*>(batch_.data()), count * sizeof(roundtrip::Sample)});
  return true;
}

}  // namespace ontime::agent

// SPDX-License-Identifier: Apache-2.0
// The measuring path is sacred: between the first counted message and the last, the threads that a message
// passes through allocate nothing, fault no page, and wait for nothing but the next message.
#include <array>
#include <atomic>
#include <cstdlib>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "realtime/realtime.hpp"
#include "roundtrip/roundtrip.hpp"

// This program's allocator counts, per thread, while a measurement lasts.
extern "C" {
void* __libc_malloc(std::size_t);               // NOLINT(bugprone-reserved-identifier)
void* __libc_calloc(std::size_t, std::size_t);  // NOLINT(bugprone-reserved-identifier)
void* __libc_realloc(void*, std::size_t);       // NOLINT(bugprone-reserved-identifier)
}

namespace {

std::atomic<bool> counting{false};
struct Allocations {
  std::atomic<pid_t> tid{0};
  std::atomic<std::uint64_t> count{0};
};
std::array<Allocations, 256> allocations;

void count() noexcept {
  if (!counting.load(std::memory_order_relaxed)) return;
  const auto tid = gettid();
  for (auto& entry : allocations) {
    pid_t empty = 0;
    if (entry.tid == tid || entry.tid.compare_exchange_strong(empty, tid)) {
      ++entry.count;
      return;
    }
  }
}

std::uint64_t allocations_of(pid_t tid) {
  for (const auto& entry : allocations)
    if (entry.tid == tid) return entry.count;
  return 0;
}

}  // namespace

extern "C" {
void* malloc(std::size_t bytes) {
  count();
  return __libc_malloc(bytes);
}
void* calloc(std::size_t number, std::size_t bytes) {
  count();
  return __libc_calloc(number, bytes);
}
void* realloc(void* old, std::size_t bytes) {
  count();
  return __libc_realloc(old, bytes);
}
}

namespace ontime::roundtrip {
namespace {

using namespace std::chrono_literals;

struct Case {
  Schedule schedule;
  transport::Receive receive;
};

class MeasuringPath : public testing::TestWithParam<Case> {};

INSTANTIATE_TEST_SUITE_P(Udp, MeasuringPath,
                         testing::Values(Case{Schedule::next_free, transport::Receive::listener},
                                         Case{Schedule::fixed, transport::Receive::waitset},
                                         Case{Schedule::back_to_back, transport::Receive::listener},
                                         Case{Schedule::back_to_back, transport::Receive::waitset}),
                         [](const auto& info_) {
                           std::string name = word_of(info_.param.schedule);
                           std::erase(name, '-');
                           return name + (info_.param.receive == transport::Receive::listener ? "_listener"
                                                                                              : "_waitset");
                         });

TEST_P(MeasuringPath, AllocatesFaultsAndWaitsForNothing) {
  if (const auto refusals = realtime::lock_memory(8 << 20); !refusals.empty())
    GTEST_SKIP() << refusals[0].asked << ": " << refusals[0].found;
  const auto& plugin = transport::load("udp");
  transport::Config config;
  config.receive = GetParam().receive;
  config.max_payload_bytes = 500;
  config.address = "127.0.0.1";
  config.domain = 2000 + getpid() % 20000;
  config.peers = {"127.0.0.1"};
  config.role = transport::Role::server;
  Server server(plugin, config);
  config.role = transport::Role::client;
  ClientOptions options;
  options.schedule = GetParam().schedule;
  options.period = 1ms;
  options.duration = 500ms;
  Client client(plugin, config, options);
  while (!client.endpoint().matched().both()) std::this_thread::sleep_for(1ms);
  client.start();
  while (client.state() != Client::State::measuring) std::this_thread::yield();

  auto threads = client.threads();
  for (const auto& thread : server.threads()) threads.push_back(thread);
  const auto states = [&] {
    std::vector<realtime::ThreadState> result;
    for (const auto& thread : threads) result.push_back(realtime::read(thread.tid).value());
    return result;
  };
  const auto before = states();
  counting = true;
  while (client.state() != Client::State::finished) std::this_thread::sleep_for(1ms);
  counting = false;
  const auto after = states();

  const auto sent = client.counters().sent;
  ASSERT_GT(sent, 100U);
  ASSERT_GE(threads.size(), 3U) << "send, and receive on both ends";
  for (std::size_t i = 0; i < threads.size(); ++i) {
    EXPECT_EQ(allocations_of(threads[i].tid), 0U) << threads[i].name;
    EXPECT_EQ(after[i].minor_faults - before[i].minor_faults, 0U) << threads[i].name;
    EXPECT_EQ(after[i].major_faults - before[i].major_faults, 0U) << threads[i].name;
    // One wait a message or cycle; the sender of back-to-back also looks for losses a hundred times a second.
    EXPECT_LE(after[i].voluntary_switches - before[i].voluntary_switches, sent + 100) << threads[i].name;
  }
}

TEST(ThisTest, SeesAllocations) {
  const auto before = allocations_of(gettid());
  counting = true;
  auto* volatile block = std::malloc(100);  // NOLINT: the point is that it is seen
  counting = false;
  std::free(block);  // NOLINT
  EXPECT_EQ(allocations_of(gettid()), before + 1);
}

}  // namespace
}  // namespace ontime::roundtrip

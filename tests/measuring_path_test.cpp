// SPDX-License-Identifier: Apache-2.0
// The measuring path is sacred: between the first counted message and the last, the threads that a message
// passes through allocate nothing, fault no page, and wait for nothing but the next message.
#include <algorithm>
#include <array>
#include <atomic>
#include <cstdlib>
#include <functional>
#include <thread>
#include <utility>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
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
  const char* transport;
  Schedule schedule;
  transport::Receive receive;
  // What the middleware itself does, found by this test and a debugger: Fast DDS 2.9 allocates a node of its
  // history for every message received, and the waitsets of both hand a lock from their receiving thread to
  // ours.
  std::uint64_t middleware_allocations = 0;  // a message, of its receiving thread
  std::uint64_t waits = 1;                   // a message
};
void PrintTo(const Case& value, std::ostream* out) {
  *out << value.transport << ' ' << word_of(value.schedule);
}

class MeasuringPath : public testing::TestWithParam<Case> {};

INSTANTIATE_TEST_SUITE_P(
    , MeasuringPath,
    testing::Values(Case{"cyclonedds", Schedule::next_free, transport::Receive::listener},
                    Case{"cyclonedds", Schedule::fixed, transport::Receive::waitset, 0, 4},
                    Case{"cyclonedds", Schedule::back_to_back, transport::Receive::listener},
                    Case{"fastdds", Schedule::next_free, transport::Receive::listener, 1},
                    Case{"fastdds", Schedule::fixed, transport::Receive::waitset, 1, 4},
                    Case{"fastdds", Schedule::back_to_back, transport::Receive::listener, 1},
                    Case{"udp", Schedule::next_free, transport::Receive::listener},
                    Case{"udp", Schedule::fixed, transport::Receive::waitset},
                    Case{"udp", Schedule::back_to_back, transport::Receive::listener},
                    Case{"udp", Schedule::back_to_back, transport::Receive::waitset}),
    [](const auto& value) {
      std::string name = std::string(value.param.transport) + "_" + word_of(value.param.schedule);
      std::erase(name, '-');
      return name + (value.param.receive == transport::Receive::listener ? "_listener" : "_waitset");
    });

// Runs an end in a process of its own: two middlewares never meet in one, and one never talks to itself.
class Child {
 public:
  explicit Child(const std::function<void(int orders)>& body) {
    std::array<int, 2> ends{};
    EXPECT_EQ(pipe(ends.data()), 0);
    pid_ = fork();
    if (pid_ == 0) {
      close(ends[1]);
      body(ends[0]);
      std::fflush(stdout);
      _exit(testing::Test::HasFailure() ? 1 : 0);
    }
    close(ends[0]);
    orders_ = ends[1];
  }
  ~Child() { EXPECT_EQ(end(), 0); }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

  void order() const { EXPECT_EQ(write(orders_, "x", 1), 1); }
  int end() {
    if (pid_ > 0) {
      close(orders_);
      waitpid(std::exchange(pid_, 0), &status_, 0);
    }
    return status_;
  }

 private:
  pid_t pid_ = 0;
  int orders_ = -1, status_ = 0;
};

void await_order(int orders) {
  char order = 0;
  static_cast<void>(read(orders, &order, 1));
}

// Between begin() and check(), the threads of an end are held to the rules.
class Watch {
 public:
  explicit Watch(const Case& value) : value_(value) {}
  void begin(std::vector<Thread> threads) {
    std::erase_if(threads,
                  [](const Thread& thread) { return thread.role != "send" && thread.role != "receive"; });
    threads_ = std::move(threads);
    before_ = states();
    counting = true;
  }
  void check(std::uint64_t messages) {
    counting = false;
    const auto after = states();
    ASSERT_FALSE(threads_.empty());
    const auto allocations = (messages + 100) * value_.middleware_allocations;
    // One wait a message or cycle; the sender of back-to-back also looks for losses a hundred times a second.
    const auto waits = (messages + 100) * value_.waits;
    for (std::size_t i = 0; i < threads_.size(); ++i) {
      EXPECT_LE(allocations_of(threads_[i].tid), allocations) << threads_[i].name;
      EXPECT_EQ(after[i].minor_faults - before_[i].minor_faults, 0U) << threads_[i].name;
      EXPECT_EQ(after[i].major_faults - before_[i].major_faults, 0U) << threads_[i].name;
      EXPECT_LE(after[i].voluntary_switches - before_[i].voluntary_switches, waits) << threads_[i].name;
    }
  }

 private:
  std::vector<realtime::ThreadState> states() const {
    std::vector<realtime::ThreadState> result;
    for (const auto& thread : threads_) result.push_back(realtime::read(thread.tid).value());
    return result;
  }
  const Case& value_;
  std::vector<Thread> threads_;
  std::vector<realtime::ThreadState> before_;
};

transport::Config config_of(const Case& value, transport::Role role) {
  transport::Config config;
  config.role = role;
  config.receive = value.receive;
  config.max_payload_bytes = 500;
  config.interface = "lo";
  config.address = "127.0.0.1";
  config.domain = 100 + getppid() % 100;
  config.peers = {"127.0.0.1"};
  return config;
}

TEST_P(MeasuringPath, AllocatesFaultsAndWaitsForNothing) {
  const auto names = transport::available();
  if (std::find(names.begin(), names.end(), GetParam().transport) == names.end())
    GTEST_SKIP() << "there is no transport " << GetParam().transport;
  if (geteuid() != 0) GTEST_SKIP() << "locking memory needs root, or limits";
  Child server([](int orders) {
    ASSERT_TRUE(realtime::lock_memory(32 << 20).empty());
    Server end(transport::load(GetParam().transport), config_of(GetParam(), transport::Role::server));
    Watch watch(GetParam());
    await_order(orders);
    watch.begin(end.threads());
    const auto before = end.answered();
    await_order(orders);
    watch.check(end.answered() - before);
    await_order(orders);
  });
  Child client([&server](int) {
    ASSERT_TRUE(realtime::lock_memory(32 << 20).empty());
    ClientOptions options;
    options.schedule = GetParam().schedule;
    options.period = 1ms;
    options.duration = 1s;
    options.warm_up = 100;
    Client end(transport::load(GetParam().transport), config_of(GetParam(), transport::Role::client),
               options);
    while (!end.endpoint().matched().both()) std::this_thread::sleep_for(1ms);
    end.start();
    while (end.state() != Client::State::measuring) std::this_thread::yield();
    Watch watch(GetParam());
    watch.begin(end.threads());
    server.order();
    while (end.counters().sent < 500) std::this_thread::sleep_for(1ms);
    server.order();
    while (end.state() != Client::State::finished) std::this_thread::sleep_for(1ms);
    watch.check(end.counters().sent);
    EXPECT_GE(end.counters().on_time, 100U);
  });
  EXPECT_EQ(client.end(), 0);
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

// SPDX-License-Identifier: Apache-2.0
// The measuring path is sacred: between the first counted message and the last, the threads that a message
// passes through allocate nothing, fault no page, and wait for nothing but the next message.
#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <memory>
#include <new>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <malloc.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include "measuring_path_cases.hpp"
#include "own_link.hpp"
#include "realtime/realtime.hpp"
#include "roundtrip/roundtrip.hpp"

// This program's allocator counts, per thread, while a measurement lasts.
extern "C" {
void* __libc_malloc(std::size_t);                 // NOLINT(bugprone-reserved-identifier)
void* __libc_calloc(std::size_t, std::size_t);    // NOLINT(bugprone-reserved-identifier)
void* __libc_realloc(void*, std::size_t);         // NOLINT(bugprone-reserved-identifier)
void* __libc_memalign(std::size_t, std::size_t);  // NOLINT(bugprone-reserved-identifier)
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

void* address_of(long result) {
  return reinterpret_cast<void*>(result);  // NOLINT(performance-no-int-to-ptr)
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
void* memalign(std::size_t alignment, std::size_t bytes) {
  count();
  return __libc_memalign(alignment, bytes);
}
void* aligned_alloc(std::size_t alignment, std::size_t bytes) {
  count();
  return __libc_memalign(alignment, bytes);
}
int posix_memalign(void** block, std::size_t alignment, std::size_t bytes) {
  count();
  *block = __libc_memalign(alignment, bytes);
  return *block == nullptr ? ENOMEM : 0;
}
void* mmap(void* at, std::size_t bytes, int protection, int flags, int fd, off_t offset) noexcept {
  count();
  return address_of(syscall(SYS_mmap, at, bytes, protection, flags, fd, offset));
}
void* mmap64(void* at, std::size_t bytes, int protection, int flags, int fd, off64_t offset) noexcept {
  return mmap(at, bytes, protection, flags, fd, offset);
}
int munmap(void* at, std::size_t bytes) noexcept {
  count();
  return static_cast<int>(syscall(SYS_munmap, at, bytes));
}
}

namespace ontime::roundtrip {
namespace {

using namespace std::chrono_literals;

// Three topics with a message each 10 ms either way, for longer than it is measured.
constexpr int background_a_second = 2 * 3 * 100;
std::unique_ptr<BackgroundTopics> background_of(const Case& value, transport::Endpoint& critical,
                                                const transport::Config& config) {
  if (!value.background) return nullptr;
  return std::make_unique<BackgroundTopics>(
      transport::load(value.transport), &critical, config,
      BackgroundOptions{
          .topics = 3, .where = *value.background, .payload_bytes = value.payload_bytes, .period = 10ms},
      1h);
}

// They send as they do in a run: before the first counted message they have long been at it.
void start(const std::unique_ptr<BackgroundTopics>& background) {
  if (!background) return;
  while (!background->matched()) std::this_thread::sleep_for(1ms);
  background->start();
  background->go();
}

std::vector<Thread> all_of(std::vector<Thread> threads, const std::unique_ptr<BackgroundTopics>& background) {
  if (background)
    for (auto& thread : background->threads())
      if (std::none_of(threads.begin(), threads.end(),
                       [&](const auto& other) { return other.tid == thread.tid; }))
        threads.push_back(std::move(thread));
  return threads;
}

class MeasuringPath : public testing::TestWithParam<Case> {};
INSTANTIATE_TEST_SUITE_P(, MeasuringPath, testing::ValuesIn(cases()), name_of);

// Runs an end in a process of its own: two middlewares never meet in one, and one never talks to itself.
class Child {
 public:
  // What is ordered of the child; each order is to be obeyed, or the child to end.
  class Orders {
   public:
    explicit Orders(int pipe) : pipe_(pipe) {}
    void await() const {
      char order = 0;
      [[maybe_unused]] const auto size = read(pipe_, &order, 1);
    }
    void obeyed() const { EXPECT_EQ(write(pipe_, "x", 1), 1); }

   private:
    int pipe_;
  };

  explicit Child(const std::function<void(Orders)>& body) {
    std::array<int, 2> ends{};
    EXPECT_EQ(socketpair(AF_UNIX, SOCK_STREAM, 0, ends.data()), 0);
    std::fflush(stdout);
    pid_ = fork();
    if (pid_ == 0) {
      close(ends[1]);
      try {
        body(Orders(ends[0]));
      } catch (const std::exception& error) {  // else it would go on with the parent's tests
        ADD_FAILURE() << error.what();
      }
      std::fflush(stdout);
      _exit(testing::Test::HasFailure() ? 1 : 0);
    }
    close(ends[0]);
    orders_ = ends[1];
  }
  ~Child() { EXPECT_EQ(end(), 0); }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

  void order() const {
    char done = 0;
    EXPECT_EQ(send(orders_, "x", 1, MSG_NOSIGNAL), 1);
    EXPECT_EQ(read(orders_, &done, 1), 1);
  }
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

// Pages that the kernel has moved, also locked ones (vm.compact_unevictable_allowed): each faults once when
// it is touched again, whatever the program does. Any machine that is short of large pages does so at any
// time.
std::uint64_t pages_moved() {
  std::ifstream file("/proc/vmstat");
  std::string name;
  for (std::uint64_t value = 0; file >> name >> value;)
    if (name == "pgmigrate_success") return value;
  return 0;
}

// Where qemu-user runs this (tests/emulated), it translates code and faults in these threads, too.
bool is_emulated() {
  return std::getenv("ONTIME_EMULATED") != nullptr;  // NOLINT(concurrency-mt-unsafe): nothing sets it
}

// Between begin() and check(), the threads of an end are held to the rules. Made once memory is locked.
class Watch {
 public:
  explicit Watch(const Case& value) : value_(value) {}
  void begin(std::vector<Thread> threads) {
    std::erase_if(threads, [](const Thread& thread) {
      return thread.role != "send" && thread.role != "receive" && thread.role != "delivery" &&
             thread.role != "resend";
    });
    threads_ = std::move(threads);
    before_ = states();
    heap_end_ = sbrk(0);
    begun_ = Clock::now();
    counting = true;
  }
  void check(std::uint64_t messages, std::uint64_t cycles) {
    counting = false;
    if (value_.background)
      for (auto* count : {&messages, &cycles}) *count += background_a_second * (seconds() + 1);
    const auto after = states();
    const auto moved = pages_moved() - moved_before_;
    ASSERT_FALSE(threads_.empty());
    EXPECT_EQ(sbrk(0), heap_end_) << "the heap grew";
    for (std::size_t i = 0; i < threads_.size(); ++i) {
      SCOPED_TRACE(threads_[i].role + " " + threads_[i].name);
      EXPECT_LE(allocations_of(threads_[i].tid), allocations_allowed(value_, messages));
      if (!is_emulated()) {
        EXPECT_LE(after[i].minor_faults - before_[i].minor_faults,
                  moved + faults_allowed(value_, messages, threads_[i]));
      }
      EXPECT_EQ(after[i].major_faults - before_[i].major_faults, 0U);
      EXPECT_LE(after[i].voluntary_switches - before_[i].voluntary_switches, waits_allowed(value_, cycles));
    }
  }

 private:
  using Clock = std::chrono::steady_clock;
  std::uint64_t seconds() const {
    return static_cast<std::uint64_t>(
        std::chrono::duration_cast<std::chrono::seconds>(Clock::now() - begun_).count());
  }
  std::vector<realtime::ThreadState> states() const {
    std::vector<realtime::ThreadState> result;
    for (const auto& thread : threads_) result.push_back(realtime::read(thread.tid).value());
    return result;
  }
  const Case& value_;
  const std::uint64_t moved_before_ = pages_moved();
  std::vector<Thread> threads_;
  std::vector<realtime::ThreadState> before_;
  void* heap_end_ = nullptr;
  Clock::time_point begun_;
};

transport::Config config_of(const Case& value, transport::Role role) {
  transport::Config config;
  config.role = role;
  config.receive = value.receive;
  config.qos.reliability = value.reliability;
  config.max_payload_bytes = value.payload_bytes;
  config.interface = "lo";
  config.address = "127.0.0.1";
  config.domain = 100 + getppid() % 100;
  config.peers = {"127.0.0.1"};
  config.launch_ns = value.launch_ns;
  if (is_below_ip(value)) {  // over OwnLink
    config.interface = role == transport::Role::client ? "near" : "far";
    config.address.clear();
    config.peers.clear();
  }
  return config;
}

TEST_P(MeasuringPath, AllocatesFaultsAndWaitsForNothing) {
  const auto names = transport::available();
  if (std::find(names.begin(), names.end(), GetParam().transport) == names.end())
    GTEST_SKIP() << "there is no transport " << GetParam().transport;
  if (geteuid() != 0) GTEST_SKIP() << "locking memory needs root, or limits";
  std::optional<OwnLink> link;
  if (is_below_ip(GetParam())) link.emplace();
  Child server([](Child::Orders orders) {
    ASSERT_TRUE(realtime::lock_memory(32 << 20).empty());
    Watch watch(GetParam());
    const auto config = config_of(GetParam(), transport::Role::server);
    Server end(transport::load(GetParam().transport), config);
    const auto background = background_of(GetParam(), end.endpoint(), config);
    start(background);
    orders.await();
    watch.begin(all_of(end.threads(), background));
    const auto before = end.answered();
    orders.obeyed();
    orders.await();
    const auto messages = end.answered() - before;
    watch.check(messages, messages);
    orders.obeyed();
    orders.await();
  });
  Child client([&server](Child::Orders) {
    ASSERT_TRUE(realtime::lock_memory(32 << 20).empty());
    Watch watch(GetParam());
    ClientOptions options;
    options.schedule = GetParam().schedule;
    options.period = 1ms;
    options.duration = 1s;
    options.payload_bytes = GetParam().payload_bytes;
    options.warm_up = 100;
    const auto config = config_of(GetParam(), transport::Role::client);
    Client end(transport::load(GetParam().transport), config, options);
    const auto background = background_of(GetParam(), end.endpoint(), config);
    while (!end.endpoint().matched().both()) std::this_thread::sleep_for(1ms);
    start(background);
    end.start();
    while (end.state() != Client::State::ready) std::this_thread::sleep_for(1ms);
    server.order();
    watch.begin(all_of(end.threads(), background));
    end.go();
    while (end.state() != Client::State::finished) std::this_thread::sleep_for(1ms);
    const auto counters = end.counters();
    watch.check(counters.sent, counters.sent + counters.skipped_cycles);
    server.order();
    EXPECT_GE(counters.on_time + counters.late, 100U);
    if (background) {
      EXPECT_GT(background->counters().sent, 0U);
      EXPECT_GT(background->counters().received, 0U);
    }
  });
  EXPECT_EQ(client.end(), 0);
}

TEST(ThisTest, SeesAllocations) {
  const std::array<std::function<void*()>, 7> ways{
      [] { return std::malloc(100); },
      [] { return std::calloc(10, 10); },
      [] { return std::realloc(nullptr, 100); },
      [] { return std::aligned_alloc(64, 128); },
      [] { return memalign(64, 100); },
      [] {
        void* block = nullptr;
        return posix_memalign(&block, 64, 100) == 0 ? block : nullptr;
      },
      [] { return ::operator new (128, std::align_val_t{128}); },
  };
  for (const auto& way : ways) {
    const auto before = allocations_of(gettid());
    counting = true;
    auto* volatile block = way();
    counting = false;
    EXPECT_NE(block, nullptr);
    std::free(block);  // NOLINT: the point is that it is seen
    EXPECT_EQ(allocations_of(gettid()), before + 1);
  }
}

TEST(ThisTest, SeesMappings) {
  const auto before = allocations_of(gettid());
  counting = true;
  auto* const page = mmap(nullptr, 4096, PROT_READ, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  munmap(page, 4096);
  counting = false;
  EXPECT_EQ(allocations_of(gettid()), before + 2);
}

}  // namespace
}  // namespace ontime::roundtrip

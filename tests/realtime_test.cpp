// SPDX-License-Identifier: Apache-2.0
#include "realtime/realtime.hpp"

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <numeric>
#include <random>
#include <set>
#include <thread>

#include <fcntl.h>
#include <gmock/gmock.h>
#include <grp.h>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "realtime/privileges.hpp"
#include "realtime/state.hpp"

namespace ontime::realtime {
namespace {

using namespace std::chrono_literals;
using namespace std::string_literals;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::MatchesRegex;
using ::testing::SizeIs;

#ifdef ONTIME_TEST_SANITIZED
constexpr bool sanitized = true;
#else
constexpr bool sanitized = false;
#endif

// A thread that does nothing until it is let go, to try settings on.
class Sleeper {
 public:
  explicit Sleeper(const std::string& name = "sleeper")
      : thread_([this, name] {
          pthread_setname_np(pthread_self(), name.c_str());
          tid_ = gettid();
          tid_.notify_all();
          done_.wait(false);
        }) {
    tid_.wait(0);
  }
  ~Sleeper() { end(); }
  void end() {
    if (!thread_.joinable()) return;
    done_ = true;
    done_.notify_all();
    thread_.join();
  }
  pid_t tid() const { return tid_; }

 private:
  std::atomic<pid_t> tid_ = 0;
  std::atomic<bool> done_ = false;
  std::thread thread_;
};

// Runs `body` in a process of its own, so that what it does to that process goes with it.
// How a child ended; 255: not as it should have.
int exit_of_child(const std::function<long()>& body) {
  constexpr int wrong = 255;
  const pid_t child = fork();
  if (child == 0) {
    const auto code = static_cast<int>(std::min(body(), wrong - 1L));
    _exit(::testing::Test::HasFailure() ? wrong : code);
  }
  int status = 0;
  EXPECT_EQ(waitpid(child, &status, 0), child);
  EXPECT_TRUE(WIFEXITED(status)) << status;
  return WIFEXITED(status) ? WEXITSTATUS(status) : wrong;
}

void in_child(const std::function<void()>& body) {
  const auto code = exit_of_child([&] {
    body();
    return 0;
  });
  EXPECT_EQ(code, 0) << "see above";
}

// Of three children. Now and then the kernel moves a page, and the next to touch it has a fault.
int fewest_faults(const std::function<long()>& of_child) {
  return std::min({exit_of_child(of_child), exit_of_child(of_child), exit_of_child(of_child)});
}

long faults_so_far() {
  const auto now = read(gettid());
  EXPECT_TRUE(now);
  return now ? static_cast<long>(now->minor_faults + now->major_faults) : 0;
}

void become_ordinary_user() {
  rlimit none{0, 0};
  ASSERT_EQ(setrlimit(RLIMIT_RTPRIO, &none), 0);
  if (geteuid() != 0) return;
  constexpr id_t nobody = 65534;
  ASSERT_EQ(setgroups(0, nullptr), 0);
  ASSERT_EQ(setresgid(nobody, nobody, nobody), 0);
  ASSERT_EQ(setresuid(nobody, nobody, nobody), 0);
}

ThreadSettings fifo(int priority) {
  ThreadSettings settings;
  settings.policy = Policy::fifo;
  settings.priority = priority;
  return settings;
}

std::vector<int> allowed_cpus() { return cpus_of(read(gettid())->cpus).value(); }

TEST(Read, SaysTheNameAsItIs) {
  const Sleeper sleeper(") R 1 (x) y");
  auto state = read(sleeper.tid());
  // It may be about to sleep for the first time.
  for (int look = 0; look < 1000 && state && state->voluntary_switches + state->involuntary_switches == 0;
       ++look) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
    state = read(sleeper.tid());
  }
  ASSERT_TRUE(state);
  EXPECT_EQ(state->tid, sleeper.tid());
  EXPECT_EQ(state->name, ") R 1 (x) y");
  EXPECT_EQ(state->policy, Policy::other);
  EXPECT_EQ(state->priority, 0);
  EXPECT_GT(state->voluntary_switches + state->involuntary_switches, 0u);
}

TEST(Read, CountsFaults) {
  const auto before = read(gettid());
  constexpr std::size_t bytes = 4 << 20;
  std::vector<char> fresh(bytes, 1);
  const auto after = read(gettid());
  ASSERT_TRUE(before && after);
  EXPECT_GT(after->minor_faults + after->major_faults, before->minor_faults + before->major_faults);
  EXPECT_EQ(fresh[bytes / 2], 1);
}

TEST(Read, EndedAndForeignThreadsGiveNoState) {
  Sleeper sleeper;
  const pid_t tid = sleeper.tid();
  EXPECT_TRUE(read(tid));
  sleeper.end();
  for (int i = 0; i < 1000 && read(tid); ++i) std::this_thread::yield();
  EXPECT_FALSE(read(tid));
  EXPECT_FALSE(read(getppid()));
  EXPECT_FALSE(read(0));
  EXPECT_FALSE(read(-1));
}

TEST(Apply, AppliedSettingsAreReadBack) {
  if (!may_use_fifo(99)) GTEST_SKIP() << "may not use SCHED_FIFO";
  const Sleeper sleeper;
  const auto cpus = allowed_cpus();
  std::mt19937 random(3);
  for (int round = 0; round < 300; ++round) {
    ThreadSettings settings;
    settings.policy = static_cast<Policy>(std::uniform_int_distribution(0, 2)(random));
    if (settings.policy != Policy::other) settings.priority = std::uniform_int_distribution(1, 99)(random);
    for (const int cpu : cpus)
      if (random() % 2 == 0) settings.cpus.push_back(cpu);
    const auto before = read(sleeper.tid());
    ASSERT_THAT(apply(sleeper.tid(), "sleeper", settings), IsEmpty());
    const auto after = read(sleeper.tid());
    ASSERT_TRUE(before && after);
    EXPECT_EQ(after->policy, settings.policy);
    EXPECT_EQ(after->priority, settings.priority);
    EXPECT_EQ(after->cpus, settings.cpus.empty() ? before->cpus : list_of(settings.cpus));
  }
}

TEST(Apply, DeadlineGoesAndComes) {
  if (!may_use_fifo(1)) GTEST_SKIP() << "may not use real-time policies";
  const Sleeper sleeper;
  ThreadSettings settings;
  settings.policy = Policy::deadline;
  settings.runtime = 100us;
  settings.deadline = 5ms;
  settings.period = 10ms;
  const auto refusals = apply(sleeper.tid(), "sleeper", settings);
  if (!refusals.empty()) GTEST_SKIP() << refusals[0].asked << ": " << refusals[0].found;
  EXPECT_EQ(read(sleeper.tid())->policy, Policy::deadline);
  const auto cpus = allowed_cpus();
  ThreadSettings back = fifo(5);
  back.cpus = {cpus.front()};
  EXPECT_THAT(apply(sleeper.tid(), "sleeper", back), IsEmpty());
  EXPECT_EQ(read(sleeper.tid())->policy, Policy::fifo);

  if (cpus.size() < 2) GTEST_SKIP() << "one CPU only";
  const auto tied = apply(sleeper.tid(), "sleeper", settings);
  ASSERT_THAT(tied, SizeIs(1));
  EXPECT_THAT(tied[0].found, HasSubstr("its CPUs are"));
  EXPECT_THAT(tied[0].remedy, HasSubstr("SCHED_DEADLINE"));
  EXPECT_EQ(read(sleeper.tid())->policy, Policy::fifo);
}

TEST(Apply, NonsenseIsRefusedAndChangesNothing) {
  const Sleeper sleeper;
  std::vector<ThreadSettings> nonsense = {fifo(0), fifo(100), fifo(-1), fifo(1 << 30), {}, {}, {}};
  nonsense[4].priority = 3;
  nonsense[5].policy = Policy::deadline;  // no runtime
  nonsense[6].policy = Policy::deadline;
  nonsense[6].runtime = -1ms;
  nonsense[6].deadline = nonsense[6].period = 10ms;
  for (const auto& settings : nonsense) {
    const auto refusals = apply(sleeper.tid(), "sleeper", settings);
    ASSERT_THAT(refusals, SizeIs(1)) << word_of(settings.policy) << settings.priority;
    EXPECT_THAT(refusals[0].asked, HasSubstr("thread sleeper"));
    EXPECT_FALSE(refusals[0].found.empty());
    EXPECT_FALSE(refusals[0].remedy.empty());
    EXPECT_EQ(read(sleeper.tid())->policy, Policy::other);
  }
}

TEST(Apply, CpusThatAreNotThereAreRefusedWhole) {
  const Sleeper sleeper;
  const auto before = read(sleeper.tid())->cpus;
  for (const auto& cpus : {std::vector{1023}, {allowed_cpus().front(), 1023}, {-1}, {0, -1}, {5000}}) {
    ThreadSettings settings;
    settings.cpus = cpus;
    const auto refusals = apply(sleeper.tid(), "sleeper", settings);
    ASSERT_THAT(refusals, SizeIs(1)) << list_of(cpus);
    EXPECT_THAT(refusals[0].asked, HasSubstr(list_of(cpus)));
    EXPECT_EQ(read(sleeper.tid())->cpus, before);
  }
}

TEST(Apply, OtherProcessesAreLeftAlone) {
  for (const pid_t tid : {getppid(), 0, -1, 1 << 30})
    EXPECT_THAT(apply(tid, "stranger", {}), SizeIs(1)) << tid;
}

TEST(Apply, AnOrdinaryUserIsToldWhatToDo) {
  in_child([] {
    become_ordinary_user();
    EXPECT_FALSE(may_use_fifo(1));
    const auto refusals = apply(gettid(), "send", fifo(80));
    ASSERT_THAT(refusals, SizeIs(1));
    EXPECT_EQ(refusals[0].asked, "SCHED_FIFO 80 for thread send");
    const auto program = std::filesystem::read_symlink("/proc/self/exe").string();
    if (refusals[0].found.find("rt_runtime_us") == std::string::npos) {
      EXPECT_EQ(refusals[0].found, "Operation not permitted (RLIMIT_RTPRIO is 0, no CAP_SYS_NICE)");
      // What gives a program nothing that its user does not have comes first.
      EXPECT_THAT(refusals[0].remedy,
                  MatchesRegex("sudo groupadd .*\n@realtime - rtprio 98\n@realtime - memlock unlimited\n.*"
                               "setcap cap_sys_nice,cap_ipc_lock\\+ep " +
                               program));
    }
    ThreadSettings ordinary;
    ordinary.cpus = {allowed_cpus().front()};
    EXPECT_THAT(apply(gettid(), "send", ordinary), IsEmpty()) << "needs no privilege";
  });
}

TEST(Apply, RootOfAUserNamespaceIsToldThatOnlyLimitsCount) {
  if (!file_of_empty_realtime_budget().empty()) GTEST_SKIP() << "no real-time budget: that is told first";
  in_child([] {
    const auto uid = geteuid(), gid = getegid();
    rlimit none{0, 0};
    ASSERT_EQ(setrlimit(RLIMIT_RTPRIO, &none), 0);
    ASSERT_EQ(setrlimit(RLIMIT_MEMLOCK, &none), 0);
    if (unshare(CLONE_NEWUSER) != 0) return;  // not permitted here
    std::ofstream("/proc/self/setgroups") << "deny";
    std::ofstream("/proc/self/uid_map") << "0 " << uid << " 1";
    std::ofstream("/proc/self/gid_map") << "0 " << gid << " 1";
    auto refusals = apply(gettid(), "send", fifo(80));
    const auto of_memory = lock_memory(0);
    refusals.insert(refusals.end(), of_memory.begin(), of_memory.end());
    ASSERT_THAT(refusals, SizeIs(2));
    for (const auto& refusal : refusals) {
      EXPECT_THAT(refusal.found, HasSubstr("outside this user namespace"));
      EXPECT_THAT(refusal.remedy, HasSubstr("on the host"));
    }
  });
}

TEST(LockMemory, AFiniteLimitIsRefusedAndLaterAllocationsStillWork) {
  in_child([] {
    rlimit small{4 << 20, 4 << 20};
    ASSERT_EQ(setrlimit(RLIMIT_MEMLOCK, &small), 0) << "the limit here is smaller yet";
    become_ordinary_user();
    const auto refusals = lock_memory(1 << 20);
    ASSERT_THAT(refusals, SizeIs(1));
    EXPECT_EQ(refusals[0].found, "RLIMIT_MEMLOCK is 4194304 bytes, no CAP_IPC_LOCK");
    EXPECT_THAT(refusals[0].remedy, HasSubstr("memlock unlimited"));
    const std::vector<char> large(64 << 20, 1);
    const Sleeper sleeper;
  });
}

TEST(LockMemory, NoFaultIsLeftInTheHeap) {
  if (sanitized) GTEST_SKIP() << "a sanitizer has its own heap";
  EXPECT_EQ(fewest_faults([] {
              constexpr std::size_t bytes = 16 << 20;
              (void)lock_memory(bytes);
              (void)faults_so_far();  // its own first time
              const auto before = faults_so_far();
              for (const std::size_t part : {bytes / 2, bytes / 4, std::size_t{4096}}) {
                auto* const memory = static_cast<char*>(std::malloc(part));
                EXPECT_NE(memory, nullptr);
                for (std::size_t at = 0; at < part; at += 512) static_cast<volatile char*>(memory)[at] = 1;
                std::free(memory);
              }
              return faults_so_far() - before;
            }),
            0);
}

TEST(LockMemory, LaterMappingsAreLocked) {
  if (sanitized) GTEST_SKIP() << "sanitizers turn mlockall off";
  in_child([] {
    if (!lock_memory(1 << 20).empty()) return;  // the refusal is tested above
    const auto locked_kib = [] {
      return std::stoll(process::field(process::text_of("/proc/self/status").value(), "VmLck").value());
    };
    constexpr std::size_t bytes = 2 << 20;
    const auto before = locked_kib();
    ASSERT_NE(mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0), MAP_FAILED);
    EXPECT_EQ(locked_kib() - before, static_cast<long long>(bytes / 1024));
  });
}

TEST(LockMemory, NoFaultIsLeftInLaterStacks) {
  if (sanitized) GTEST_SKIP() << "sanitizers turn mlockall off";
  EXPECT_EQ(fewest_faults([] {
              long faults = 0;
              if (!lock_memory(1 << 20).empty()) return faults;  // the refusal is tested above
              std::thread([&faults] {
                (void)faults_so_far();
                const auto untouched = faults_so_far();
                char stack[2 << 20];
                for (std::size_t at = 0; at < sizeof stack; at += 512)
                  static_cast<volatile char*>(stack)[at] = 1;
                faults = faults_so_far() - untouched;
              }).join();
              return faults;
            }),
            0);
}

TEST(CpuLatency, HoldsAsLongAsItLives) {
  const int device = open("/dev/cpu_dma_latency", O_RDONLY | O_CLOEXEC);
  if (device < 0) GTEST_SKIP() << "/dev/cpu_dma_latency cannot be read";
  const auto now_us = [] {
    // A reader counts as a request as soon as it is opened, without a wish of its own.
    const int fd = open("/dev/cpu_dma_latency", O_RDONLY | O_CLOEXEC);
    std::int32_t latency_us = -1;
    EXPECT_EQ(::read(fd, &latency_us, sizeof latency_us), static_cast<ssize_t>(sizeof latency_us));
    close(fd);
    return latency_us;
  };
  // Another process may ask for less meanwhile: an ontime of another test.
  const auto settled_us = [&](std::int32_t expected) {
    for (int look = 0; look < 1000 && now_us() != expected; ++look) std::this_thread::sleep_for(10ms);
    return now_us();
  };
  close(device);
  const auto before = now_us();
  if (before <= 3) GTEST_SKIP() << "another process asks for " << before << " µs";
  {
    const CpuLatencyRequest request(3us);
    EXPECT_FALSE(request.refusal());
    EXPECT_EQ(settled_us(3), 3);
  }
  EXPECT_EQ(settled_us(before), before);
}

TEST(CpuLatency, RefusesWhatIsNoLatency) {
  EXPECT_TRUE(CpuLatencyRequest(-1us).refusal());
  EXPECT_TRUE(CpuLatencyRequest(std::chrono::hours(1)).refusal());
}

TEST(CpuLatency, AnOrdinaryUserIsToldWhatToDo) {
  in_child([] {
    become_ordinary_user();
    const CpuLatencyRequest request(0us);
    if (!request.refusal()) return;  // this machine permits it to all users
    EXPECT_THAT(request.refusal()->found, HasSubstr("/dev/cpu_dma_latency"));
    EXPECT_FALSE(request.refusal()->remedy.empty());
  });
}

// Whether there is a counter at all is the machine's affair; that it counts is ours.
TEST(Instructions, AreCountedWhereTheCpuCan) {
  const InstructionCounter counter(gettid());
  const auto before = counter.value();
  if (!before) GTEST_SKIP() << "this CPU, or the kernel's settings, give no counter of instructions";
  std::atomic<int> work{0};
  while (work < 1000) ++work;
  EXPECT_GT(counter.value().value(), *before + 1000);
}

TEST(CpuTime, ThreadTimeGrowsAsItWorks) {
  const auto before = read(gettid()).value().cpu_time;
  std::chrono::nanoseconds now = before;
  for (std::uint64_t work = 0; now == before && work < 1'000'000; ++work)
    now = read(gettid()).value().cpu_time;
  EXPECT_GT(now, before);
}

}  // namespace
}  // namespace ontime::realtime

// SPDX-License-Identifier: Apache-2.0
#include "background/background.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include <fcntl.h>
#include <gmock/gmock.h>
#include <linux/capability.h>
#include <sched.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include "background/child.hpp"
#include "background_processes.hpp"

namespace ontime::background {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

constexpr std::uint64_t mebibyte = 1 << 20;

// stress-ng's temporary folder, gone with the test.
class Load : public ::testing::Test {
 protected:
  void SetUp() override {
    ASSERT_NE(mkdtemp(directory_.data()), nullptr);
    if (!installed()) GTEST_SKIP() << "stress-ng is not installed";
  }
  void TearDown() override { fs::remove_all(directory_); }

  static bool installed() {
    return fs::exists("/usr/bin/stress-ng") || fs::exists("/usr/local/bin/stress-ng");
  }

  std::string directory_ = (fs::temp_directory_path() / "ontime-load-test-XXXXXX").string();
  const Workers few_{1, 1, 1, 1, 8 * mebibyte, 8 * mebibyte};
};

// stress-ng, started by this process.
pid_t stress_of(pid_t parent) {
  const auto found = where([&](const process::Stat& process) {
    return process.parent == parent && process.name.starts_with("stress-ng");
  });
  return found.size() == 1 ? found.front().pid : -1;
}

// stress-ng and all its workers: they stay in the group that it leads.
std::vector<process::Stat> group(pid_t leader) {
  return where([&](const process::Stat& process) { return process.group == leader; });
}

std::string pid_namespace_of(pid_t pid) {
  return fs::read_symlink("/proc/" + std::to_string(pid) + "/ns/pid").string();
}

std::vector<std::string> names(const std::vector<process::Stat>& some) {
  std::vector<std::string> result;
  result.reserve(some.size());
  for (const auto& process : some) result.push_back(process.name);
  return result;
}

bool gone_within(std::chrono::seconds limit, pid_t leader) {
  for (const auto end = std::chrono::steady_clock::now() + limit; !group(leader).empty();
       std::this_thread::sleep_for(10ms))
    if (std::chrono::steady_clock::now() > end) return false;
  return true;
}

std::string error_of(const Workers& workers, const std::string& directory) {
  try {
    const auto running = stress(workers, directory);
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

// Of the calling thread.
void drop(int capability) {
  __user_cap_header_struct header{_LINUX_CAPABILITY_VERSION_3, 0};
  std::array<__user_cap_data_struct, _LINUX_CAPABILITY_U32S_3> sets{};
  ASSERT_EQ(syscall(SYS_capget, &header, sets.data()), 0);
  sets[0].effective &= ~(1U << static_cast<unsigned>(capability));
  ASSERT_EQ(syscall(SYS_capset, &header, sets.data()), 0);
}

// A process that starts load, says so, and waits; killed with the test at the latest.
class Victim {
 public:
  Victim(
      const Workers& workers, const std::string& directory, const std::function<void()>& before = [] {}) {
    std::array<int, 2> told;
    EXPECT_EQ(pipe2(told.data(), O_CLOEXEC), 0);
    pid_ = fork();
    if (pid_ == 0) {
      prctl(PR_SET_PDEATHSIG, SIGKILL);
      before();
      try {
        const auto running = stress(workers, directory);
        EXPECT_EQ(write(told[1], "+", 1), 1);
        pause();
      } catch (const Error& error) {
        fprintf(stderr, "%s\n", error.what());
      }
      _exit(1);
    }
    close(told[1]);
    told_ = told[0];
  }
  ~Victim() {
    kill_9();
    close(told_);
  }
  Victim(const Victim&) = delete;
  Victim& operator=(const Victim&) = delete;

  bool started() const {
    char said = 0;
    return read(told_, &said, 1) == 1;
  }
  void kill_9() {
    if (pid_ <= 0) return;
    kill(pid_, SIGKILL);
    waitpid(pid_, nullptr, 0);
    pid_ = -1;
  }
  pid_t pid() const { return pid_; }

 private:
  pid_t pid_;
  int told_;
};

TEST_F(Load, AllWorkersRunAndAllAreGoneAfterwards) {
  pid_t leader = -1;
  {
    const auto running = stress({2, 1, 1, 1, 8 * mebibyte, 8 * mebibyte}, directory_);
    EXPECT_TRUE(running->running());
    leader = stress_of(getpid());
    ASSERT_GT(leader, 0);
    EXPECT_GE(where([&](const process::Stat& process) { return process.parent == leader; }).size(), 5u);
  }
  EXPECT_THAT(group(leader), IsEmpty());
  EXPECT_TRUE(fs::is_empty(directory_)) << "its files are there still";
  EXPECT_EQ(waitpid(-1, nullptr, WNOHANG), -1) << "a child is left to be waited for";
}

TEST_F(Load, EndedLoadIsNotRunning) {
  const auto running = stress({1}, directory_);
  const pid_t leader = stress_of(getpid());
  ASSERT_GT(leader, 0);
  EXPECT_TRUE(running->running());
  kill(leader, SIGKILL);
  EXPECT_TRUE(gone_within(60s, leader));
  EXPECT_FALSE(running->running());
  EXPECT_FALSE(running->running());
}

TEST_F(Load, IsOrdinaryWhateverTheCallerIs) {
  cpu_set_t before, one;
  ASSERT_EQ(sched_getaffinity(0, sizeof before, &before), 0);
  int first = 0;
  while (!CPU_ISSET(static_cast<unsigned>(first), &before)) ++first;
  CPU_ZERO(&one);
  CPU_SET(static_cast<unsigned>(first), &one);
  sigset_t all;
  sigfillset(&all);
  std::thread([&] {
    const sched_param high{50};
    const bool realtime = sched_setscheduler(0, SCHED_FIFO, &high) == 0;
    sched_setaffinity(0, sizeof one, &one);
    constexpr int of_process = 1, only_when_idle = 3 << 13;  // of ioprio_set(2)
    syscall(SYS_ioprio_set, of_process, 0, only_when_idle);
    setpriority(PRIO_PROCESS, 0, 19);
    const bool may_raise = setpriority(PRIO_PROCESS, 0, 0) == 0;  // root of a container may lack SYS_NICE
    setpriority(PRIO_PROCESS, 0, 19);
    pthread_sigmask(SIG_SETMASK, &all, nullptr);
    signal(SIGPIPE, SIG_IGN);
    const auto running = stress(few_, directory_);
    const auto some = group(stress_of(getpid()));
    EXPECT_GE(some.size(), 5u);
    for (const auto& process : some) {
      EXPECT_EQ(sched_getscheduler(process.pid), SCHED_OTHER) << process.name;
      EXPECT_EQ(getpriority(PRIO_PROCESS, static_cast<id_t>(process.pid)), may_raise ? 0 : 19)
          << process.name;
      EXPECT_NE(syscall(SYS_ioprio_get, of_process, process.pid), only_when_idle) << process.name;
      cpu_set_t cpus;
      EXPECT_EQ(sched_getaffinity(process.pid, sizeof cpus, &cpus), 0);
      EXPECT_TRUE(CPU_EQUAL(&cpus, &before)) << process.name;
      std::ifstream status("/proc/" + std::to_string(process.pid) + "/status");
      for (std::string line; std::getline(status, line);) {
        if (!line.starts_with("SigBlk") && !line.starts_with("SigIgn")) continue;
        EXPECT_EQ(std::stoull(line.substr(8), nullptr, 16) & (1ULL << (SIGTERM - 1)), 0u) << line;
      }
    }
    EXPECT_EQ(sched_getscheduler(0), realtime ? SCHED_FIFO : SCHED_OTHER) << "the caller's own has changed";
  }).join();
  signal(SIGPIPE, SIG_DFL);
}

TEST(Start, AProgramCanHaveTheCallersScheduling) {
  std::thread([] {
    setpriority(PRIO_PROCESS, 0, 19);
    const process::Memory output;
    const Child child(start({"nice"}, output.fd(), {}, Scheduling::callers).pid);
    EXPECT_TRUE(wait_until([&] { return child.ended(); }, 60s));
    EXPECT_EQ(output.text(), "19\n");
  }).join();
}

TEST_F(Load, NothingOutlivesAKilledProcess) {
  Victim victim({2, 2, 2, 2, 8 * mebibyte, 8 * mebibyte}, directory_);
  ASSERT_TRUE(victim.started());
  const pid_t leader = stress_of(victim.pid());
  ASSERT_GT(leader, 0);
  ASSERT_GE(group(leader).size(), 9u);
  victim.kill_9();
  EXPECT_TRUE(gone_within(60s, leader)) << ::testing::PrintToString(names(group(leader)));
}

// stress-ng's workers ask to be told of their parent's death only a while after they have been forked.
TEST_F(Load, NothingOutlivesAProcessKilledDuringTheStart) {
  std::mt19937 random(1);
  for (int round = 0; round < 20; ++round) {
    Victim victim({4, 4, 2, 2, 8 * mebibyte, 8 * mebibyte}, directory_, [&] {
      if (round % 2 == 0) drop(CAP_SYS_ADMIN);  // then it has no PID namespace
    });
    pid_t leader = -1;
    for (int look = 0; look < 10000 && leader < 0; ++look) leader = stress_of(victim.pid());
    ASSERT_GT(leader, 0);
    std::this_thread::sleep_for(std::chrono::microseconds(random() % 60000));
    victim.kill_9();
    EXPECT_TRUE(gone_within(60s, leader)) << ::testing::PrintToString(names(group(leader)));
  }
}

// Neither root nor user namespaces: what stress-ng does by itself must do.
TEST_F(Load, WorksWhereNoNamespaceIsPermitted) {
  Victim victim(few_, directory_, [] {
    (void)unshare(CLONE_NEWUSER);
    std::ofstream("/proc/sys/user/max_pid_namespaces") << 0;
  });
  ASSERT_TRUE(victim.started());
  const pid_t leader = stress_of(victim.pid());
  ASSERT_GT(leader, 0);
  if (pid_namespace_of(leader) != pid_namespace_of(getpid())) GTEST_SKIP() << "could not be forbidden here";
  victim.kill_9();
  EXPECT_TRUE(gone_within(60s, leader)) << ::testing::PrintToString(names(group(leader)));
}

// In an ordinary container, root may make no namespace.
TEST_F(Load, OfRootWithoutSysAdminRunsAndNothingOutlivesIt) {
  if (geteuid() != 0) GTEST_SKIP() << "needs root";
  std::thread([&] {
    drop(CAP_SYS_ADMIN);
    const auto running = stress(few_, directory_);
    const auto leader = stress_of(getpid());
    EXPECT_GE(group(leader).size(), 5u);
    EXPECT_TRUE(wait_until([&] { return running->end(); }, 60s));
    EXPECT_THAT(group(leader), IsEmpty());
  }).join();
  Victim victim(few_, directory_, [] { drop(CAP_SYS_ADMIN); });
  ASSERT_TRUE(victim.started());
  const pid_t leader = stress_of(victim.pid());
  victim.kill_9();
  EXPECT_TRUE(gone_within(60s, leader)) << ::testing::PrintToString(names(group(leader)));
}

// A rootless container maps one user: the user nobody is not there.
TEST_F(Load, OfRootWithoutOtherUsersRuns) {
  const pid_t trial = fork();
  if (trial == 0) _exit(unshare(CLONE_NEWUSER) == 0 ? 0 : 1);
  int status = -1;
  ASSERT_EQ(waitpid(trial, &status, 0), trial);
  if (status != 0) GTEST_SKIP() << "user namespaces are not permitted here";
  Victim victim(few_, directory_, [] {
    const auto uid = geteuid(), gid = getegid();
    ASSERT_EQ(unshare(CLONE_NEWUSER), 0);
    std::ofstream("/proc/self/setgroups") << "deny";
    std::ofstream("/proc/self/uid_map") << "0 " << uid << " 1";
    std::ofstream("/proc/self/gid_map") << "0 " << gid << " 1";
    ASSERT_EQ(geteuid(), 0u);
  });
  EXPECT_TRUE(victim.started());
}

TEST_F(Load, LeavesNoDescriptorOpen) {
  const auto open_files = [] {
    return std::distance(fs::directory_iterator("/proc/self/fd"), fs::directory_iterator());
  };
  const auto before = open_files();
  { const auto running = stress({1}, directory_); }
  (void)error_of(few_, directory_ + "/missing");
  EXPECT_EQ(open_files(), before);
}

TEST_F(Load, ErrorQuotesOutputOfStressNg) {
  // The folder has another name in each run: the same failure of all is to be the same text.
  EXPECT_THAT(error_of({1}, directory_ + "/missing"),
              AllOf(HasSubstr("No such file"), Not(HasSubstr("missing"))));
  EXPECT_THAT(error_of({0, 1, 0, 0, 1, 0}, directory_),
              AllOf(HasSubstr("stress-ng --temp-path"), HasSubstr("ended at once"), HasSubstr("vm-bytes"),
                    Not(HasSubstr(directory_))));
  EXPECT_EQ(waitpid(-1, nullptr, WNOHANG), -1) << "a child is left to be waited for";
}

// stress-ng divides what it is told among its workers.
TEST_F(Load, EachVmWorkerHasTheMemoryThatIsStated) {
  const auto running = stress({.vm = 3, .vm_bytes = 16 * mebibyte}, directory_);
  EXPECT_GE(running->vm_bytes(), 16 * mebibyte);
  EXPECT_LT(running->vm_bytes(), 17 * mebibyte);
}

TEST_F(Load, EachHddWorkerWritesTheSizeThatIsStated) {
  const auto running = stress({.hdd = 2, .hdd_bytes = 8 * mebibyte}, directory_);
  EXPECT_TRUE(wait_until([&] { return running->hdd_bytes() == 8 * mebibyte; }, 30s));
  EXPECT_EQ(stress({.cpu = 1}, directory_)->hdd_bytes(), 0u);
  const auto leader = stress_of(getpid());
  const auto largest_file = [&] {
    std::uintmax_t largest = 0;
    for (const auto& process : group(leader)) {
      std::error_code none;
      for (const auto& entry : fs::directory_iterator("/proc/" + std::to_string(process.pid) + "/fd", none)) {
        const auto file = fs::read_symlink(entry.path(), none);
        if (file.string().find("stress-ng-hdd") == std::string::npos) continue;
        if (const auto size = fs::file_size(entry.path(), none); !none) largest = std::max(largest, size);
      }
    }
    return largest;
  };
  EXPECT_TRUE(wait_until([&] { return largest_file() == 8 * mebibyte; }, 30s));
}

// As in a container: only SYS_PTRACE may look into the files of another user.
TEST_F(Load, SizesOfFilesThatMayNotBeSeenAreUnknown) {
  if (geteuid() != 0) GTEST_SKIP() << "needs root";
  std::thread([&] {
    drop(CAP_SYS_PTRACE);
    EXPECT_EQ(stress({.hdd = 1, .hdd_bytes = 8 * mebibyte}, directory_)->hdd_bytes(), std::nullopt);
  }).join();
}

TEST_F(Load, OfRootRunsAsNobodyWithoutPrivileges) {
  if (geteuid() != 0) GTEST_SKIP() << "needs root";
  const auto running = stress(few_, directory_);
  const auto some = group(stress_of(getpid()));
  EXPECT_GE(some.size(), 5u);
  for (const auto& process : some) {
    std::ifstream status("/proc/" + std::to_string(process.pid) + "/status");
    for (std::string line; std::getline(status, line);) {
      if (line.starts_with("Uid:")) {
        EXPECT_EQ(line, "Uid:\t65534\t65534\t65534\t65534") << process.name;
      }
      if (line.starts_with("CapPrm:") || line.starts_with("CapEff:")) {
        EXPECT_THAT(line, HasSubstr("\t0000000000000000")) << process.name;
      }
    }
  }
}

TEST_F(Load, WorkerThatWasKilledIsMissed) {
  const auto running = stress({.cpu = 2}, directory_);
  EXPECT_TRUE(running->running());
  const auto leader = stress_of(getpid());
  const auto workers = where([&](const process::Stat& process) { return process.parent == leader; });
  ASSERT_EQ(workers.size(), 2u);
  kill(workers.front().pid, SIGKILL);
  EXPECT_TRUE(wait_until([&] { return !running->running(); }, 60s));
}

// A process in a frozen group of version 1 is not even killed, as one in an uninterruptible call is not.
TEST_F(Load, UnkillableLoadDoesNotBlockItsEnd) {
  const fs::path freezer = "/sys/fs/cgroup/freezer/ontime-load-test";
  std::error_code none;
  if (geteuid() != 0 || !fs::create_directory(freezer, none)) GTEST_SKIP() << "needs root and a freezer";
  auto running = stress({.cpu = 1}, directory_);
  const auto leader = stress_of(getpid());
  for (const auto& process : group(leader)) std::ofstream(freezer / "cgroup.procs") << process.pid;
  std::ofstream(freezer / "freezer.state") << "FROZEN";
  EXPECT_FALSE(wait_until([&] { return running->end(); }, 4s));
  running.reset();
  EXPECT_FALSE(group(leader).empty()) << "it could be killed";
  std::ofstream(freezer / "freezer.state") << "THAWED";
  EXPECT_TRUE(gone_within(60s, leader));
  waitpid(leader, nullptr, 0);
  EXPECT_TRUE(wait_until([&] { return fs::remove(freezer, none); }, 60s));
}

TEST_F(Load, BadNumbersAreRefused) {
  EXPECT_THAT(error_of({}, directory_), HasSubstr("no workers"));
  EXPECT_THAT(error_of({-1, 2}, directory_), HasSubstr("-1 cpu"));
  EXPECT_THAT(error_of({2, 0, 0, -3}, directory_), HasSubstr("-3 hdd"));
}

TEST_F(Load, SaysWhatToInstall) {
  // NOLINTBEGIN(concurrency-mt-unsafe): there is no other thread
  const auto* const path = std::getenv("PATH");
  const std::string before = path != nullptr ? path : "";
  setenv("PATH", directory_.c_str(), 1);
  const auto said = error_of({1}, directory_);
  std::ofstream(directory_ + "/env") << "#!/bin/sh\necho 'env: Datei nicht gefunden'\nexit 127\n";
  fs::permissions(directory_ + "/env", fs::perms::owner_all);
  const auto in_german = error_of({1}, directory_);
  std::ofstream(directory_ + "/env")
      << "#!/bin/sh\necho 'stress-ng: error while loading shared libraries: libsctp.so.1'\nexit 127\n";
  const auto without_library = error_of({1}, directory_);
  setenv("PATH", before.c_str(), 1);
  // NOLINTEND(concurrency-mt-unsafe)
  EXPECT_THAT(said, HasSubstr("apt install stress-ng"));
  EXPECT_THAT(in_german, HasSubstr("apt install stress-ng"));
  EXPECT_THAT(without_library, AllOf(HasSubstr("libsctp.so.1"), Not(HasSubstr("apt install"))));
  EXPECT_EQ(waitpid(-1, nullptr, WNOHANG), -1) << "a child is left to be waited for";
}

// As in a container: without KILL, the load would stay for ever.
TEST_F(Load, IsNotStartedByARootThatLacksACapability) {
  if (geteuid() != 0) GTEST_SKIP() << "needs root";
  for (const auto& [capability, name] :
       {std::pair(CAP_KILL, "KILL"), {CAP_CHOWN, "CHOWN"}, {CAP_DAC_OVERRIDE, "DAC_OVERRIDE"}})
    std::thread([&, capability = capability, name = name] {
      drop(capability);
      EXPECT_THAT(error_of({1}, directory_), HasSubstr(fmt::format("--cap-add {}", name)));
    }).join();
}

TEST(OutputOf, EndlessCommandTimesOut) {
  try {
    output_of({"sleep", "60"}, "coreutils", 10ms);
    FAIL() << "it ended";
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), AllOf(HasSubstr("sleep 60"), HasSubstr("timed out")));
  }
}

}  // namespace
}  // namespace ontime::background

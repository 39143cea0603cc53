// SPDX-License-Identifier: Apache-2.0
#include "machine/machine.hpp"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include <arpa/inet.h>
#include <fcntl.h>
#include <gmock/gmock.h>
#include <grp.h>
#include <netinet/in.h>
#include <poll.h>
#include <sched.h>
#include <signal.h>
#include <sys/mount.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "machine/command.hpp"
#include "machine/journal_file.hpp"
#include "machine/proc.hpp"
#include "machine/undo.hpp"

namespace ontime::machine {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::AnyOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;
using ::testing::StartsWith;

constexpr const char* inside_variable = "ONTIME_HOST_TEST_INSIDE";
bool has_own_run = false;

// NOLINTBEGIN(concurrency-mt-unsafe): before any thread, or in a process of its own
void set(const char* name, const std::string& value) { setenv(name, value.c_str(), 1); }
bool inside_another() { return std::getenv(inside_variable) != nullptr; }
// NOLINTEND(concurrency-mt-unsafe)

// Root gets a /run of its own, seen by this process and its children only: journals and namespaces of these
// tests and of an ontime that runs on this machine do not meet. Others get a folder.
class OwnRun : public ::testing::Environment {
 public:
  void SetUp() override {
    if (inside_another()) return;
    if (geteuid() == 0) {
      has_own_run = unshare(CLONE_NEWNS) == 0 &&
                    mount("none", "/", nullptr, MS_REC | MS_PRIVATE, nullptr) == 0 &&
                    mount("none", "/run", "tmpfs", 0, "mode=755") == 0;
      return;
    }
    ASSERT_NE(mkdtemp(folder_.data()), nullptr);
    set("XDG_RUNTIME_DIR", folder_);
  }
  void TearDown() override {
    if (!inside_another() && geteuid() != 0) fs::remove_all(folder_);
  }

 private:
  std::string folder_ = (fs::temp_directory_path() / "ontime-host-test-XXXXXX").string();
};
[[maybe_unused]] const auto* const own_run = ::testing::AddGlobalTestEnvironment(new OwnRun);

int status_of(pid_t child) {
  int status = -1;
  EXPECT_EQ(waitpid(child, &status, 0), child);
  return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
}

pid_t start_child(const std::function<void()>& body) {
  const pid_t child = fork();
  if (child != 0) return child;
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  try {
    body();
  } catch (const std::exception& error) {
    ADD_FAILURE() << error.what();
  }
  _exit(::testing::Test::HasFailure() ? 1 : 0);
}

void in_child(const std::function<void()>& body) {
  EXPECT_EQ(status_of(start_child(body)), 0) << "see above";
}

// A process with a journal, killed by kill -9 once it has made its changes. What it says is told to the test.
class Victim {
 public:
  explicit Victim(const std::function<std::string(Journal&)>& change) {
    std::array<int, 2> told;
    EXPECT_EQ(pipe2(told.data(), O_CLOEXEC), 0);
    pid_ = start_child([&] {
      Journal journal;
      const auto said = change(journal) + "\n";
      EXPECT_EQ(write(told[1], said.data(), said.size()), static_cast<ssize_t>(said.size()));
      pause();
    });
    close(told[1]);
    for (char one = 0; read(told[0], &one, 1) == 1 && one != '\n';) said_ += one;
    close(told[0]);
  }
  ~Victim() {
    kill_9();
    wait();
  }
  Victim(const Victim&) = delete;
  Victim& operator=(const Victim&) = delete;
  const std::string& said() const { return said_; }
  pid_t pid() const { return pid_; }
  void kill_9() {
    if (pid_ <= 0) return;
    kill(pid_, SIGKILL);
    siginfo_t info{};
    waitid(P_PID, static_cast<id_t>(pid_), &info, WEXITED | WNOWAIT);  // it stays a zombie
  }
  void wait() {
    if (pid_ > 0) waitpid(pid_, nullptr, 0);
    pid_ = -1;
  }

 private:
  pid_t pid_;
  std::string said_;
};

std::string error_of(const std::function<void()>& action) {
  try {
    action();
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

void become_ordinary_user() {
  constexpr id_t nobody = 65534;
  ASSERT_EQ(setgroups(0, nullptr), 0);
  ASSERT_EQ(setresgid(nobody, nobody, nobody), 0);
  ASSERT_EQ(setresuid(nobody, nobody, nobody), 0);
}

std::string make_folder(Journal& journal) {
  auto path = journal.add_directory("ontime-host-test");
  fs::create_directories(path + "/in/side");
  std::ofstream(path + "/in/side/file") << "text";
  return path;
}

// --- what /proc says

TEST(Proc, FieldsAreFoundByTheirWholeName) {
  const std::string text =
      "vendor_id\t: A\nmodel\t\t: 17\nmodel name\t: AMD EPYC: 7\nempty :\nmodel name : second\n";
  EXPECT_EQ(field(text, "model name"), "AMD EPYC: 7");
  EXPECT_EQ(field(text, "model"), "17");
  EXPECT_EQ(field(text, "empty"), "");
  EXPECT_FALSE(field(text, "name"));
  EXPECT_FALSE(field("", "model"));
}

TEST(Proc, NumbersAreWholeOrNothing) {
  EXPECT_EQ(number("-1\n"), -1);
  EXPECT_EQ(number("950000\n"), 950000);
  for (const auto* text : {"", "\n", "max", "1 2", "1x", "99999999999999999999"})
    EXPECT_FALSE(number(text)) << text;
  EXPECT_FALSE(number(std::nullopt));
}

TEST(Proc, AProcessMayHaveAnyName) {
  const std::string rest = " S 1 7 7 0 -1 4194304 11 12 13 14 15 16 17 18 20 0 1 0 4242";
  for (const auto* name : {"a", "a b", ") R 1 (", "((", "1) S 2 3"}) {
    const auto process = parse_process("7 (" + std::string(name) + ")" + rest + " 99 98\n");
    ASSERT_TRUE(process) << name;
    EXPECT_EQ(process->state, 'S');
    EXPECT_EQ(process->start_ticks, 4242u);
  }
  const auto whole = "7 (a)" + rest;
  for (std::size_t length = 0; length <= whole.rfind(' '); ++length)
    EXPECT_FALSE(parse_process(whole.substr(0, length))) << length;
}

TEST(Proc, TicksAndStalls) {
  Activity activity;
  parse_ticks("cpu  10 20 30 400 50 6 7 8 9 10\ncpu0 1 1 1 1 1 1 1 1 1 1\n", activity);
  EXPECT_EQ(activity.total_ticks, 531u);
  EXPECT_EQ(activity.busy_ticks, 81u);
  EXPECT_EQ(parse_stall("some avg10=0.00 avg60=1.00 avg300=0.00 total=123\nfull avg10=0.00 total=7\n"), 123);
  for (const auto* text : {"", "full total=1", "some avg10=0.00", "some total=x"})
    EXPECT_EQ(parse_stall(text), -1);
}

TEST(Proc, PreemptionBySurestWord) {
  const std::string debian = "#1 SMP PREEMPT_DYNAMIC Debian 6.1.0-1 (2023)";
  EXPECT_EQ(preemption("1\n", {}, "", debian), "rt");
  EXPECT_EQ(preemption({}, {}, "", "#1 SMP PREEMPT_RT Debian"), "rt");
  EXPECT_EQ(preemption("0\n", "none (voluntary) full\n", "preempt=full", debian), "voluntary");
  EXPECT_EQ(preemption({}, "none voluntary full (lazy)\n", "", debian), "lazy");
  EXPECT_EQ(preemption({}, {}, "quiet preempt=full ro", debian), "full");
  EXPECT_EQ(preemption({}, {}, "nopreempt=full", debian), "dynamic");
  EXPECT_EQ(preemption({}, {}, "", "#1 SMP PREEMPT Mon"), "full");
  EXPECT_EQ(preemption({}, {}, "", "#1 SMP Mon"), "none or voluntary");
  EXPECT_FALSE(preemption({}, {}, "", ""));
  EXPECT_EQ(preemption({}, ")(", "", "#1 SMP Mon"), "none or voluntary");
}

TEST(Proc, CgroupsFromTheInnermostOut) {
  const std::string text = "4:memory:/a/b\n3:cpu,cpuacct:/c\n1:name=systemd:/x\n0::/d:e/f\n";
  EXPECT_THAT(cgroups_of(text, "memory"), ElementsAre("/a/b", "/a", ""));
  EXPECT_THAT(cgroups_of(text, "cpuacct"), ElementsAre("/c", ""));
  EXPECT_THAT(cgroups_of(text, ""), ElementsAre("/d:e/f", "/d:e", ""));
  EXPECT_THAT(cgroups_of("0::/\n", ""), ElementsAre(""));
  EXPECT_THAT(cgroups_of(text, "mem"), IsEmpty());
  EXPECT_THAT(cgroups_of("nonsense", ""), IsEmpty());
}

TEST(Proc, Capabilities) {
  EXPECT_TRUE(has_capability("CapPrm:\t0\nCapEff:\t0000000000201000\n", 21));
  EXPECT_TRUE(has_capability("CapEff:\t0000000000201000\n", 12));
  EXPECT_FALSE(has_capability("CapEff:\t0000000000201000\n", 20));
  EXPECT_FALSE(has_capability("CapPrm:\tffffffffffffffff\n", 1));
  EXPECT_FALSE(has_capability("", 1));
}

// --- this machine

TEST(Describe, SaysEverythingAndGuessesNothing) {
  const auto machine = describe();
  for (const auto* key : {"hostname", "kernel_release", "kernel_version", "kernel_command_line", "preemption",
                          "rt_runtime_us", "rt_period_us", "cpu_model", "cpu_count", "isolated_cpus",
                          "governor", "clocksource", "virtual_machine", "memory_bytes", "limits"})
    EXPECT_TRUE(machine.contains(key)) << key;
  for (const auto* key : {"rtprio", "memlock_bytes", "cgroup_memory_bytes"})
    EXPECT_TRUE(machine["limits"].contains(key)) << key;
  EXPECT_EQ(machine["kernel_release"], word(text_of("/proc/sys/kernel/osrelease")));
  EXPECT_EQ(machine["hostname"], word(text_of("/proc/sys/kernel/hostname")));
  EXPECT_GE(machine["cpu_count"], 1);
  EXPECT_GT(machine["memory_bytes"], 0);
  for (const auto& [key, value] : machine.items())
    EXPECT_TRUE(value.dump() != "\"\"" || key == "isolated_cpus") << key << " is empty, not null";
}

TEST(Describe, LimitsAreThisProcesss) {
  in_child([] {
    const rlimit limit{4096, 4096};
    ASSERT_EQ(setrlimit(RLIMIT_MEMLOCK, &limit), 0);
    EXPECT_EQ(describe()["limits"]["memlock_bytes"], 4096);
  });
}

TEST(ActivityBetween, IsAShare) {
  const Activity first{100, 1000, 0, -1, 5000, 1'000'000'000};
  const Activity last{125, 1100, 250'000, -1, 9'000'000, 2'000'000'000};
  const auto share = between(first, last);
  EXPECT_EQ(share["cpu_busy"], 0.25);
  EXPECT_EQ(share["cpu_pressure"], 0.25);
  EXPECT_TRUE(share["memory_pressure"].is_null());
  EXPECT_EQ(share["io_pressure"], 1.0);
}

TEST(ActivityBetween, NothingWhereNoTimePassed) {
  const auto now = activity();
  for (const auto& share : between(now, now)) EXPECT_TRUE(share.is_null());
  EXPECT_GT(now.total_ticks, 0u);
  EXPECT_GE(now.total_ticks, now.busy_ticks);
  EXPECT_GT(now.at_ns, 0);
}

TEST(ActivityBetween, IsAlwaysAShareOrNothing) {
  std::mt19937_64 random(1);
  for (int round = 0; round < 2000; ++round) {
    const auto some = [&] { return random() >> (random() % 64); };
    const auto stall = [&] { return static_cast<std::int64_t>(some() >> 1) - 1; };
    const Activity first{some(), some(), stall(), stall(), stall(), stall()};
    const Activity last{some(), some(), stall(), stall(), stall(), stall()};
    const auto shares = between(first, last);
    for (const auto& [key, share] : shares.items())
      EXPECT_TRUE(share.is_null() || (share >= 0.0 && share <= 1.0)) << key << share;
  }
}

TEST(Interfaces, LoopbackIsOneAndNoNameComesTwice) {
  auto all = interfaces();
  const auto loopback =
      std::find_if(all.begin(), all.end(), [](const Interface& one) { return one.loopback; });
  ASSERT_NE(loopback, all.end());
  EXPECT_EQ(loopback->name, "lo");
  EXPECT_THAT(loopback->address, AnyOf("127.0.0.1", ""));
  std::vector<std::string> names;
  std::transform(all.begin(), all.end(), std::back_inserter(names),
                 [](const Interface& one) { return one.name; });
  std::sort(names.begin(), names.end());
  EXPECT_EQ(std::unique(names.begin(), names.end()), names.end());
}

// --- the journal's file

TEST(JournalFile, OwnersComeBackFromNames) {
  std::mt19937_64 random(1);
  for (int round = 0; round < 200; ++round) {
    const Owner owner{static_cast<pid_t>(1 + random() % 4'000'000), random()};
    EXPECT_EQ(owner_of(name_of(owner, static_cast<unsigned>(random()))), owner);
  }
  for (const auto* name :
       {"", ".", "1-2-3", "1-2.journal", "1-2-3.journal~", "-1-2-3.journal", "0-2-3.journal", "x-2-3.journal",
        "1-2-x.journal", "1--3.journal", "99999999999-2-3.journal"})
    EXPECT_FALSE(owner_of(name)) << name;
}

TEST(JournalFile, CutAnywhereItHoldsTheChangesWrittenToTheirEnd) {
  std::mt19937 random(2);
  for (int round = 0; round < 50; ++round) {
    std::vector<Change> changes;
    std::vector<std::size_t> ends;
    std::string text;
    for (int i = 0; i < 5; ++i) {
      changes.push_back({random() % 2 == 0 ? "namespace" : "directory", "/a b/" + std::to_string(random())});
      text += line_of(changes.back());
      ends.push_back(text.size());
    }
    for (std::size_t length = 0; length <= text.size(); ++length) {
      const auto whole =
          std::count_if(ends.begin(), ends.end(), [&](std::size_t end) { return end <= length; });
      EXPECT_EQ(parse_journal(text.substr(0, length)), std::vector(changes.begin(), changes.begin() + whole));
    }
  }
}

TEST(JournalFile, ThisProcessIsAliveAndNoOtherHasItsPlace) {
  const auto self = this_process();
  EXPECT_TRUE(alive(self));
  EXPECT_FALSE(alive({self.pid, self.start_ticks + 1}));
  EXPECT_FALSE(alive({1 << 30, self.start_ticks}));
}

// --- taking back

class Journals : public ::testing::Test {
 protected:
  void TearDown() override {
    EXPECT_FALSE(fs::exists(journal_folder())) << "a journal is left";
    EXPECT_THAT(revert_abandoned(), IsEmpty());
  }
};

TEST_F(Journals, AFolderGoesWithItsContents) {
  std::string one, two;
  {
    Journal journal;
    one = make_folder(journal);
    two = make_folder(journal);
    EXPECT_NE(one, two);
    struct stat found {};
    ASSERT_EQ(stat(one.c_str(), &found), 0);
    EXPECT_EQ(found.st_mode & 0777U, 0700U);
    EXPECT_THAT(revert_abandoned(), IsEmpty()) << "its owner lives";
    EXPECT_TRUE(fs::exists(one) && fs::exists(two));
  }
  EXPECT_FALSE(fs::exists(one) || fs::exists(two));
}

TEST_F(Journals, CanBeRevertedAgainAndUsedAfterwards) {
  Journal journal;
  journal.revert();
  const auto one = make_folder(journal);
  journal.revert();
  EXPECT_FALSE(fs::exists(one));
  EXPECT_FALSE(fs::exists(journal_folder()));
  journal.revert();
  const auto two = make_folder(journal);
  fs::remove_all(two);  // somebody else was quicker
  journal.revert();
}

TEST_F(Journals, TwoOfOneProcessDoNotDisturbEachOther) {
  Journal one;
  const auto first = make_folder(one);
  {
    Journal two;
    make_folder(two);
  }
  EXPECT_TRUE(fs::exists(first));
}

TEST_F(Journals, LinksAreNotFollowed) {
  Journal outer;
  const auto kept = make_folder(outer);
  {
    Journal inner;
    fs::create_symlink(kept, make_folder(inner) + "/link");
  }
  EXPECT_TRUE(fs::exists(kept + "/in/side/file"));
}

TEST_F(Journals, BadNamesAreRefusedAndLeaveNothing) {
  Journal journal;
  for (const auto* name : {"", ".", "..", "a/b", "../a", "/tmp/a", "a b", "a\nb", "-a", "a\x7f"}) {
    EXPECT_NE(error_of([&] { journal.add_directory(name); }), "") << name;
    EXPECT_NE(error_of([&] { journal.add_namespace(name); }), "") << name;
    EXPECT_FALSE(fs::exists(journal_folder()));
  }
}

TEST_F(Journals, NoTemporaryFolderIsAnError) {
  in_child([] {
    set("TMPDIR", "/there/is/none");
    Journal journal;
    EXPECT_THAT(error_of([&] { journal.add_directory("a"); }), HasSubstr("TMPDIR"));
  });
}

TEST_F(Journals, WithoutAJournalNothingIsChanged) {
  in_child([] {
    Journal journal;
    const auto folder = fs::temp_directory_path() / ("ontime-host-test-" + std::to_string(getpid()));
    fs::create_directory(folder);
    set("TMPDIR", folder.string());
    signal(SIGXFSZ, SIG_IGN);
    const rlimit nothing{0, RLIM_INFINITY};
    ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &nothing), 0);
    EXPECT_THAT(error_of([&] { journal.add_directory("a"); }), HasSubstr("without a journal nothing"));
    EXPECT_TRUE(fs::is_empty(folder));
    fs::remove(folder);
  });
}

TEST_F(Journals, WhatAKilledProcessLeftIsTakenBack) {
  Victim victim([](Journal& journal) { return make_folder(journal); });
  ASSERT_TRUE(fs::exists(victim.said()));
  EXPECT_THAT(revert_abandoned(), IsEmpty()) << "it lives";
  victim.kill_9();
  EXPECT_THAT(revert_abandoned(),
              ElementsAre(AllOf(HasSubstr(victim.said()), HasSubstr(std::to_string(victim.pid())))))
      << "not yet waited for, but gone";
  EXPECT_FALSE(fs::exists(victim.said()));
}

TEST_F(Journals, AForkedChildOwnsNothing) {
  Journal journal;
  const auto path = make_folder(journal);
  in_child([&] {
    journal.revert();
    EXPECT_TRUE(fs::exists(path));
    EXPECT_THAT(revert_abandoned(), IsEmpty());
  });
  EXPECT_TRUE(fs::exists(path));
}

TEST_F(Journals, AForkedChildThatLivesOnKeepsNothing) {
  std::array<int, 2> hold;
  ASSERT_EQ(pipe2(hold.data(), O_CLOEXEC), 0);
  Victim victim([&](Journal& journal) {
    auto path = make_folder(journal);
    if (fork() == 0) {
      close(hold[1]);
      char end = 0;
      (void)!read(hold[0], &end, 1);  // lives as long as the test wants
      _exit(0);
    }
    return path;
  });
  victim.kill_9();
  victim.wait();
  EXPECT_THAT(revert_abandoned(), SizeIs(1));
  EXPECT_FALSE(fs::exists(victim.said()));
  close(hold[0]);
  close(hold[1]);
}

TEST_F(Journals, AHalfWrittenLineIsNoChange) {
  Journal outer;
  const auto kept = make_folder(outer);
  Victim victim([&](Journal& journal) {
    auto path = make_folder(journal);
    for (const auto& [file, owner] : journal_files())
      if (owner == this_process()) std::ofstream(file, std::ios::app) << "directory " << kept;
    return path;
  });
  victim.kill_9();
  EXPECT_THAT(revert_abandoned(), ElementsAre(HasSubstr(victim.said())));
  EXPECT_TRUE(fs::exists(kept));
}

TEST_F(Journals, KilledAtAnyInstantNothingStays) {
  std::mt19937 random(3);
  const auto folder = fs::temp_directory_path() / ("ontime-host-test-" + std::to_string(getpid()));
  fs::create_directory(folder);
  for (int round = 0; round < 40; ++round) {
    const pid_t child = start_child([&] {
      set("TMPDIR", folder.string());
      for (;;) {
        Journal journal;
        make_folder(journal);
        make_folder(journal);
      }
    });
    std::this_thread::sleep_for(std::chrono::microseconds(random() % 5000));
    kill(child, SIGKILL);
    waitpid(child, nullptr, 0);
    revert_abandoned();
    EXPECT_TRUE(fs::is_empty(folder));
    EXPECT_FALSE(fs::exists(journal_folder()));
  }
  fs::remove_all(folder);
}

TEST_F(Journals, TwoThatRevertAtOnceDoItOnce) {
  for (int round = 0; round < 20; ++round) {
    Victim victim([](Journal& journal) { return make_folder(journal) + "," + make_folder(journal); });
    victim.kill_9();
    std::array<int, 2> start;
    ASSERT_EQ(pipe2(start.data(), O_CLOEXEC), 0);
    std::array<pid_t, 2> reverters{};
    for (auto& reverter : reverters)
      reverter = start_child([&] {
        close(start[1]);
        char end = 0;
        (void)!read(start[0], &end, 1);  // both wait for the pipe to close
        const auto lines = revert_abandoned();
        const auto comma = victim.said().find(',');
        // Whoever returns, all is gone; what was done is told by one of them.
        EXPECT_FALSE(fs::exists(victim.said().substr(0, comma)) ||
                     fs::exists(victim.said().substr(comma + 1)));
        _exit(::testing::Test::HasFailure() ? 100 : static_cast<int>(lines.size()));
      });
    close(start[0]);
    close(start[1]);
    int told = 0;
    for (const pid_t child : reverters) told += status_of(child);
    EXPECT_EQ(told, 2);
  }
}

// A journal as a process that is gone would have left it.
std::string abandoned_journal(const std::string& text) {
  fs::create_directory(journal_folder());
  fs::permissions(journal_folder(), fs::perms::owner_all);
  auto path = journal_folder() + '/' + name_of({1 << 30, 1}, 0);
  std::ofstream(path) << text;
  return path;
}

TEST_F(Journals, WhatIsNotUnderstoodIsToldAndKept) {
  const auto path = abandoned_journal("governor performance\n");
  for (int again = 0; again < 2; ++again)
    EXPECT_THAT(revert_abandoned(), ElementsAre(AllOf(HasSubstr("governor performance"), HasSubstr(path))));
  remove_journal(path);
}

TEST_F(Journals, GarbageHarmsNothing) {
  std::mt19937 random(4);
  for (int round = 0; round < 300; ++round) {
    std::string text;
    for (auto length = random() % 60; length > 0; --length)
      text += random() % 8 == 0 ? (random() % 2 == 0 ? '\n' : ' ') : static_cast<char>(random() % 256);
    const auto path = abandoned_journal(text);
    EXPECT_EQ(revert_abandoned().size(), parse_journal(text).size());
    remove_journal(path);
  }
  for (const auto* text :
       {"namespace \n", "namespace ../../etc/x\n", "directory \n", "directory etc\n", "\n"}) {
    const auto path = abandoned_journal(text);
    EXPECT_THAT(revert_abandoned(), SizeIs(1)) << text;
    remove_journal(path);
  }
}

// --- two machines on one

class Namespaces : public Journals {
 protected:
  void SetUp() override {
    if (!may_join_namespaces()) GTEST_SKIP() << "needs root with CAP_SYS_ADMIN and CAP_NET_ADMIN";
    if (!has_own_run) GTEST_SKIP() << "no mount namespace of its own";
    if (!there_is_ip()) GTEST_SKIP() << "iproute2 is not installed";
  }
  static bool there_is_ip() {
    return error_of([] { ip({"-Version"}); }).empty();
  }
};

bool exist() { return fs::exists(namespace_path("controller")) || fs::exists(namespace_path("component")); }

// A UDP socket that lives in that namespace, whoever uses it.
int socket_in(const std::string& name, const std::string& address) {
  int fd = -1;
  std::thread([&] {
    const int other = open(namespace_path(name).c_str(), O_RDONLY | O_CLOEXEC);
    EXPECT_EQ(setns(other, CLONE_NEWNET), 0);
    close(other);
    fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    sockaddr_in local{};
    local.sin_family = AF_INET;
    local.sin_port = htons(7411);
    inet_pton(AF_INET, address.c_str(), &local.sin_addr);
    EXPECT_EQ(bind(fd, reinterpret_cast<sockaddr*>(&local), sizeof local), 0);
  }).join();
  return fd;
}

void send_to(int fd, const std::string& address) {
  sockaddr_in peer{};
  peer.sin_family = AF_INET;
  peer.sin_port = htons(7411);
  inet_pton(AF_INET, address.c_str(), &peer.sin_addr);
  EXPECT_EQ(sendto(fd, "x", 1, 0, reinterpret_cast<sockaddr*>(&peer), sizeof peer), 1) << address;
}

bool arrives(int fd) {
  pollfd readable{fd, POLLIN, 0};
  char byte = 0;
  return poll(&readable, 1, 5000) == 1 && recv(fd, &byte, 1, 0) == 1;
}

TEST_F(Namespaces, TheFirstMessageArrivesAndNothingStays) {
  {
    Journal journal;
    const auto pair = join_namespaces(journal);
    EXPECT_THAT(pair.controller.prefix, ElementsAre("ip", "netns", "exec", "controller"));
    EXPECT_EQ(pair.component.name, "component");
    for (const auto& end : {pair.controller, pair.component}) {
      EXPECT_LE(end.interface.size(), 15u);
      const auto shown = ip({"-netns", end.name, "-oneline", "address", "show", "dev", end.interface});
      EXPECT_THAT(shown, HasSubstr(end.address + "/30"));
    }
    const int controller = socket_in("controller", pair.controller.address);
    const int component = socket_in("component", "0.0.0.0");
    send_to(controller, pair.component.address);
    EXPECT_TRUE(arrives(component));
    send_to(component, pair.controller.address);
    EXPECT_TRUE(arrives(controller));

    const int discovery = socket_in("controller", "239.255.0.1");
    ip_mreqn group{};
    inet_pton(AF_INET, "239.255.0.1", &group.imr_multiaddr);
    EXPECT_EQ(setsockopt(discovery, IPPROTO_IP, IP_ADD_MEMBERSHIP, &group, sizeof group), 0);
    send_to(component, "239.255.0.1");
    EXPECT_TRUE(arrives(discovery));
    for (const int fd : {controller, component, discovery}) close(fd);
  }
  EXPECT_FALSE(exist());
}

TEST_F(Namespaces, CanBeMadeAgainAtOnce) {
  for (int round = 0; round < 3; ++round) {
    Journal journal;
    EXPECT_EQ(error_of([&] { join_namespaces(journal); }), "");
  }
}

TEST_F(Namespaces, AnotherOntimeIsNamed) {
  Victim other([](Journal& journal) { return join_namespaces(journal).component.name; });
  ASSERT_EQ(other.said(), "component");
  Journal journal;
  EXPECT_THAT(error_of([&] { join_namespaces(journal); }),
              HasSubstr("process id " + std::to_string(other.pid())));
  journal.revert();
  EXPECT_TRUE(exist()) << "they are the other's";
  other.kill_9();
  EXPECT_EQ(error_of([&] { join_namespaces(journal); }), "") << "what a dead one left is cleared on the way";
}

TEST_F(Namespaces, SomebodyElsesIsLeftAlone) {
  ip({"netns", "add", "component"});
  {
    Journal journal;
    EXPECT_THAT(error_of([&] { join_namespaces(journal); }), HasSubstr("ip netns delete component"));
  }
  EXPECT_TRUE(fs::exists(namespace_path("component")));
  EXPECT_FALSE(fs::exists(namespace_path("controller")));
  ip({"netns", "delete", "component"});
}

TEST_F(Namespaces, AQuickerOnesIsNotRemoved) {
  Victim quicker([](Journal& journal) {
    journal.add_namespace("controller");
    return "made";
  });
  ASSERT_EQ(quicker.said(), "made");
  abandoned_journal("namespace controller\n");  // killed before `ip` could tell it that it came second
  EXPECT_THAT(revert_abandoned(), IsEmpty());
  EXPECT_TRUE(exist());
  quicker.kill_9();
  EXPECT_THAT(revert_abandoned(), SizeIs(1));
  EXPECT_FALSE(exist());
}

// Run by the next test, inside `ip netns exec`.
TEST(Inside, RevertsWhatAKilledProcessLeft) {
  if (!inside_another()) GTEST_SKIP() << "runs inside `ip netns exec` only";
  EXPECT_THAT(revert_abandoned(), ElementsAre(HasSubstr("component"), HasSubstr("controller")));
}

TEST_F(Namespaces, AreGoneOutsideWhenRevertedFromInside) {
  Victim victim([](Journal& journal) { return join_namespaces(journal).component.name; });
  ASSERT_EQ(victim.said(), "component");
  victim.kill_9();
  const auto self = fs::read_symlink("/proc/self/exe").string();
  const pid_t inside = start_child([&] {
    set(inside_variable, "1");
    execlp("ip", "ip", "netns", "exec", "component", self.c_str(), "--gtest_filter=Inside.*", nullptr);
  });
  EXPECT_EQ(status_of(inside), 0);
  EXPECT_FALSE(exist());
  EXPECT_THAT(revert_abandoned(), IsEmpty());
}

TEST_F(Namespaces, SaysWhatToInstall) {
  in_child([] {
    set("PATH", "/there/is/none");
    Journal journal;
    EXPECT_THAT(error_of([&] { join_namespaces(journal); }), HasSubstr("apt install iproute2"));
    EXPECT_FALSE(fs::exists(journal_folder())) << "nothing was changed";
  });
}

TEST(NamespacesOfOthers, NeedPrivilege) {
  in_child([] {
    if (geteuid() == 0) become_ordinary_user();
    EXPECT_FALSE(may_join_namespaces());
    Journal journal;
    EXPECT_THAT(error_of([&] { join_namespaces(journal); }), HasSubstr("run as root"));
  });
}

TEST(Ip, SaysWhatItSaid) {
  const auto said = error_of([] { ip({"link", "show", "no-such-link"}); });
  if (said.find("iproute2") != std::string::npos) GTEST_SKIP() << said;
  EXPECT_THAT(said, AllOf(StartsWith("ip link show no-such-link failed: "),
                          HasSubstr("no-such-link\" does not exist")));
}

}  // namespace
}  // namespace ontime::machine

// SPDX-License-Identifier: Apache-2.0
#include "settings/settings.hpp"

#include <algorithm>
#include <fstream>

#include <sys/prctl.h>

#include "own_run.hpp"
#include "settings/kinds.hpp"
#include "settings_fixture.hpp"

namespace ontime::settings {
namespace {

using test::error_of;
using test::in_child;
using testing::AllOf;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;
using testing::StartsWith;

TEST(Kinds, TouchOnlyWhatTheyAreFor) {
  EXPECT_TRUE(thread.accepts("14:25:ksoftirqd/0"));
  EXPECT_TRUE(thread.accepts("14:25:irq/41-eth0"));
  EXPECT_TRUE(thread_priority.accepts("14:25:irq/41-eth0"));
  EXPECT_FALSE(thread_priority.accepts("14:25:napi/eth0-8193")) << "its CPUs are set too";
  for (const auto* what :
       {"14:25:sshd", "1:25:", "x:25:ksoftirqd/0", "14:ksoftirqd/0", "ksoftirqd/0", "::irq/1"})
    EXPECT_FALSE(thread.accepts(what)) << what;
  EXPECT_TRUE(network_sysctl.accepts("net/core/rmem_max"));
  for (const auto* what : {"net/core/../../kernel/core_pattern", "kernel/core_pattern", "net/core/"})
    EXPECT_FALSE(network_sysctl.accepts(what) || kernel_sysctl.accepts(what)) << what;
  EXPECT_TRUE(steering.accepts("3:eth0/rx-0"));
  for (const auto* what :
       {"3:../x/rx-0", "3:eth0/tx-0", "3:eth0/rx-", "3:eth0", "3:eth0/rx-0/../../x", "/rx-0", "eth0/rx-0"})
    EXPECT_FALSE(steering.accepts(what)) << what;
  for (const auto* what :
       {"..", ".", "", "a/b", "a b", "sixteencharacter", "a';reboot;'", "a`b", "a$b", "a\nb"})
    for (const auto& interface : {std::string(what), std::string("3:") + what})
      EXPECT_FALSE(threaded.accepts(interface) || gro.accepts(interface) || coalescing.accepts(interface))
          << interface;
  EXPECT_TRUE(gro.accepts("3:eth0"));
  // Read as a number, the first would be interface 2, and the second end the program.
  for (const auto* what : {"4294967298:eth0", "99999999999999999999999:eth0"})
    EXPECT_FALSE(gro.accepts(what) || steering.accepts(std::string(what) + "/rx-0")) << what;
  EXPECT_FALSE(governor.accepts("cpufreq") || governor.accepts("cpu0/../cpu1") || interrupt.accepts("41/x"));
}

TEST(Threads, AreThoseThatTheyWere) {
  if (geteuid() != 0) GTEST_SKIP() << "needs root";
  const auto found = threads_named("ksoftirqd/");
  ASSERT_THAT(found, testing::Not(IsEmpty()));
  const auto& what = found.front().what;
  ASSERT_TRUE(thread.read(what));
  const auto first = what.find(':'), second = what.find(':', first + 1);
  const auto later =
      what.substr(0, first) + ":1" + what.substr(first + 1, second - first) + what.substr(second + 1);
  EXPECT_FALSE(thread.read(later)) << "another that has its id by now";
  EXPECT_THROW(thread_priority.write(later, "fifo:1", "other:0"), journal::Error);
  EXPECT_FALSE(thread.read("1:" + what.substr(first + 1))) << "no thread of the kernel";
}

TEST(Threads, AreNotGoneWhereTheyAreNotSeen) {
  if (geteuid() != 0) GTEST_SKIP() << "needs root";
  const auto what = threads_named("ksoftirqd/").front().what;
  in_child([&] {
    ASSERT_EQ(unshare(CLONE_NEWPID | CLONE_NEWNS), 0);
    in_child([&] {
      ASSERT_EQ(mount("proc", "/proc", "proc", 0, nullptr), 0);
      EXPECT_THAT(error_of([&] { thread.read(what); }), HasSubstr("container"));
    });
  });
}

TEST(Files, AreNotGoneWhereTheyAreNotSeen) {
  if (geteuid() != 0) GTEST_SKIP() << "needs root";
  in_child([&] {
    ASSERT_EQ(unshare(CLONE_NEWNS), 0);
    ASSERT_EQ(mount("", "/", "", MS_REC | MS_PRIVATE, nullptr), 0);
    for (const auto* folder : {"/sys", "/proc/sys", "/proc/irq"})
      ASSERT_EQ(mount("tmpfs", folder, "tmpfs", 0, nullptr), 0);
    for (const auto& [kind, what] : {std::pair(&kernel_sysctl, "kernel/timer_migration"),
                                     {&network_sysctl, "net/core/busy_poll"},
                                     {&governor, "cpu0"},
                                     {&workqueues, "unbound"},
                                     {&interrupt, "41:PCI-MSI 524288"}})
      EXPECT_THAT(error_of([&, &read = kind->read, &name = what] { read(name); }), HasSubstr("not visible"))
          << kind->name;
  });
}

// As in an ordinary container.
TEST(Files, ThatAreReadOnlyCannotBeSet) {
  if (geteuid() != 0) GTEST_SKIP() << "needs root";
  in_child([&] {
    ASSERT_EQ(unshare(CLONE_NEWNS), 0);
    ASSERT_EQ(mount("", "/", "", MS_REC | MS_PRIVATE, nullptr), 0);
    ASSERT_EQ(mount("/proc/sys", "/proc/sys", "", MS_BIND, nullptr), 0);
    ASSERT_EQ(mount("", "/proc/sys", "", MS_BIND | MS_REMOUNT | MS_RDONLY, nullptr), 0);
    const auto states = show({});
    const auto state =
        std::ranges::find(states, std::string("rmem-max"), [](const auto& one) { return one.setting->name; });
    ASSERT_THAT(state->things, SizeIs(1));
    EXPECT_THAT(state->cannot, AllOf(HasSubstr("read-only"), HasSubstr("docker run --privileged")));
    const auto written = [](const std::string& value) {
      require_writable(plan({{"rmem-max", value}}, {}), {});
    };
    EXPECT_THAT(error_of([&] { written("123456"); }),
                StartsWith("rmem-max: /proc/sys/net/core/rmem_max is read-only"));
    const auto now = state->things.front().second;
    EXPECT_EQ(error_of([&] { written(now); }), "") << "there is nothing to write";
  });
}

TEST(Files, CannotBeSetByRootOfAUserNamespace) {
  if (geteuid() != 0) GTEST_SKIP() << "needs root";
  in_child([&] {
    test::become_ordinary_user();
    if (unshare(CLONE_NEWUSER) != 0) return;  // not permitted here
    prctl(PR_SET_DUMPABLE, 1);                // else /proc/self is the machine's root's
    std::ofstream("/proc/self/setgroups") << "deny";
    std::ofstream("/proc/self/uid_map") << "0 65534 1";
    ASSERT_EQ(geteuid(), 0u);
    const auto states = show({});
    const auto state =
        std::ranges::find(states, std::string("rmem-max"), [](const auto& one) { return one.setting->name; });
    EXPECT_THAT(state->cannot, HasSubstr("docker run --privileged as root"));
  });
}

TEST(Cpus, OfflineCpusAreLeftOut) {
  if (geteuid() != 0) GTEST_SKIP() << "needs root";
  in_child([] {
    const std::string cpus = "/sys/devices/system/cpu";
    ASSERT_EQ(unshare(CLONE_NEWNS), 0);
    ASSERT_EQ(mount("", "/", "", MS_REC | MS_PRIVATE, nullptr), 0);
    ASSERT_EQ(mount("tmpfs", cpus.c_str(), "tmpfs", 0, nullptr), 0);
    std::filesystem::create_directories(cpus + "/cpu0/cpufreq");
    std::ofstream(cpus + "/cpu0/cpufreq/scaling_governor") << "powersave";
    std::filesystem::create_directories(cpus +
                                        "/cpu1/cpufreq/scaling_governor");  // which no program can read
    std::ofstream(cpus + "/online") << "0";
    EXPECT_THAT(error_of([] { governor.read("cpu1"); }), HasSubstr("cpu1"));
    for (const auto& [name, thing] : Wishes{{"governor", "cpu0"}, {"ksoftirqd", "ksoftirqd/0"}}) {
      const auto things = setting(name).things("");
      ASSERT_THAT(things, SizeIs(1));
      EXPECT_EQ(things[0].title(), thing);
    }
  });
}

// Of names of one length: a file of the kernel is written as a whole, these are only overwritten.
TEST(Cpus, GovernorIsSetWhereItExistsAndGivenBack) {
  if (geteuid() != 0 || !test::has_own_run) GTEST_SKIP() << "needs root";
  in_child([] {
    const std::string cpus = "/sys/devices/system/cpu";
    const auto file = [&](const std::string& path) { return cpus + "/" + path; };
    ASSERT_EQ(unshare(CLONE_NEWNS), 0);
    ASSERT_EQ(mount("", "/", "", MS_REC | MS_PRIVATE, nullptr), 0);
    ASSERT_EQ(mount("tmpfs", cpus.c_str(), "tmpfs", 0, nullptr), 0);
    std::ofstream(file("online")) << "0-1";
    for (const auto* cpu : {"cpu0/cpufreq", "cpu1/cpufreq"}) {
      std::filesystem::create_directories(file(cpu));
      std::ofstream(file(cpu) + "/scaling_governor") << "powersave\n";
      std::ofstream(file(cpu) + "/scaling_available_governors") << "userspace powersave \n";
    }
    const auto governors = [&] {
      return text_of(file("cpu0/cpufreq/scaling_governor")) + " " +
             text_of(file("cpu1/cpufreq/scaling_governor"));
    };
    journal::Journal journal(kinds());
    for (const auto* other : {"user", "ondemand"})
      EXPECT_THAT(error_of([&] {
                    apply(journal, {{"governor", other}}, {});
                  }),
                  AllOf(StartsWith("governor: cpu0 has no governor"), HasSubstr("userspace powersave")));
    std::ofstream(file("cpu1/cpufreq/scaling_available_governors")) << "powersave";
    EXPECT_THAT(error_of([&] { apply(journal, {{"governor", "userspace"}}, {}); }), HasSubstr("cpu1"));
    EXPECT_EQ(governors(), "powersave powersave") << "none is changed where one cannot be";
    std::ofstream(file("cpu1/cpufreq/scaling_available_governors")) << "powersave userspace";
    const auto changes = apply(journal, {{"governor", "userspace"}}, {});
    EXPECT_EQ(governors(), "userspace userspace");
    EXPECT_THAT(take_back(journal, changes), IsEmpty());
    EXPECT_EQ(governors(), "powersave powersave");
  });
}

// An interrupt's thread that does nothing here.
class InterruptThread : public testing::Test {
 protected:
  void SetUp() override {
    if (geteuid() != 0 || !test::has_own_run) GTEST_SKIP() << "needs root";
    if (sysconf(_SC_NPROCESSORS_ONLN) < 2) GTEST_SKIP() << "needs two CPUs";
    const auto found = threads_named("irq/");
    const auto idle =
        std::ranges::find_if(found, [](const Thing& one) { return one.title().ends_with("ACPI:Ged"); });
    if (idle == found.end()) GTEST_SKIP() << "needs a thread of an interrupt that never comes";
    thing_ = *idle;
    ASSERT_EQ(sched_getaffinity(pid(), sizeof before_, &before_), 0);
    state_ = *thread.read(thing_.what);
  }
  void TearDown() override {
    if (state_.empty()) return;
    EXPECT_EQ(sched_setaffinity(pid(), sizeof before_, &before_), 0);
    const auto now = *thread.read(thing_.what);
    EXPECT_EQ(now, state_);
    if (now != state_) thread.write(thing_.what, state_, now);
  }
  pid_t pid() const { return std::stoi(thing_.what); }
  // As the kernel does when the interrupt's CPUs change.
  void move_to(unsigned cpu) const {
    cpu_set_t set;
    CPU_ZERO(&set);
    CPU_SET(cpu, &set);
    ASSERT_EQ(sched_setaffinity(pid(), sizeof set, &set), 0);
  }

  Thing thing_{};
  cpu_set_t before_{};
  std::string state_;
};

TEST_F(InterruptThread, ThreadMovedByTheKernelIsRestored) {
  journal::Journal journal(kinds());
  move_to(1);
  const auto before = *thing_.kind->read(thing_.what);
  journal.change(*thing_.kind, thing_.what, with_priority(before, "90"));
  move_to(0);
  EXPECT_EQ(thing_.kind->read(thing_.what), "fifo:90");
  EXPECT_THAT(journal.revert(), IsEmpty());
  EXPECT_EQ(thing_.kind->read(thing_.what), before);
  EXPECT_EQ(thread.read(thing_.what), before + ":0") << "its CPUs stay the kernel's";
}

TEST_F(InterruptThread, EarlierVersionsJournalIsRestored) {
  journal::Journal journal(kinds());
  journal.change(thread, thing_.what, with_priority(state_, "90"));
  EXPECT_THAT(*thing_.kind->read(thing_.what), "fifo:90");
  EXPECT_THAT(journal.revert(), IsEmpty());
}

TEST(Interrupts, AreThoseThatTheyWere) {
  for (const auto& entry : std::filesystem::directory_iterator("/proc/irq")) {
    const auto name = entry.path().filename().string();
    if (name.find_first_not_of("0123456789") != name.npos) continue;
    const auto what = interrupt_here(std::stoi(name));
    EXPECT_EQ(interrupt.read(what), text_of(entry.path() / "smp_affinity_list"));
    EXPECT_FALSE(interrupt.read(what + "1")) << "another line that has its number by now";
    EXPECT_THROW(interrupt.write(what + "1", "0", "0"), journal::Error);
    EXPECT_EQ(Thing({&interrupt, what}).title(), "interrupt " + name);
    return;
  }
}

}  // namespace
}  // namespace ontime::settings

int main(int argc, char** argv) {
  testing::AddGlobalTestEnvironment(new ontime::test::OwnRun);
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}

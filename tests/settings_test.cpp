// SPDX-License-Identifier: Apache-2.0
#include "settings/settings.hpp"

#include <algorithm>
#include <fstream>
#include <iterator>
#include <memory>
#include <sstream>

#include <fmt/format.h>
#include <net/if.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/wait.h>

#include "own_run.hpp"
#include "settings/kinds.hpp"
#include "settings_by_name.hpp"

namespace ontime::settings {
namespace {

using test::error_of;
using test::in_child;
using testing::AllOf;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;
using testing::StartsWith;

std::string text_of(const std::string& path) {
  std::ifstream file(path);
  std::string text(std::istreambuf_iterator<char>(file), {});
  text.erase(text.find_last_not_of('\n') + 1);
  return text;
}

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

// --- on an interface of our own: a veth pair in a network namespace that only this process is in

class OnVeth : public testing::Test {
 protected:
  static void inside(const std::function<void()>& body) {
    if (geteuid() != 0 || !test::has_own_run) GTEST_SKIP() << "needs root";
    if (sysconf(_SC_NPROCESSORS_ONLN) < 2) GTEST_SKIP() << "needs two CPUs";
    in_child([&] {
      ASSERT_EQ(unshare(CLONE_NEWNET | CLONE_NEWNS), 0);
      ASSERT_EQ(mount("sysfs", "/sys", "sysfs", 0, nullptr), 0);
      ASSERT_EQ(
          std::system(
              "ip link add left type veth peer name right && ip link set left up && ip link set right up "
              "&& ip address add 10.9.8.1/24 dev left"),
          0);
      body();
    });
  }
  static std::string threaded_file() { return text_of("/sys/class/net/left/threaded"); }
  static inline const Link left{"left", ""};
};

TEST_F(OnVeth, NapiIsThreadedPrioritisedAndGivenBack) {
  inside([] {
    const auto before = *gro.read(interface_here("left"));
    {
      journal::Journal journal(kinds());
      const auto changes =
          apply(journal, {{"gro", "on"}, {"threaded-napi", "on"}, {"napi-threads", "60"}, {"napi-cpus", "0"}},
                left);
      EXPECT_EQ(threaded_file(), "1");
      const auto threads = threads_named("napi/left-");
      ASSERT_THAT(threads, SizeIs(1));
      const auto pid = std::stoi(threads[0].what);
      EXPECT_EQ(sched_getscheduler(pid), SCHED_FIFO);
      EXPECT_EQ(thread.read(threads[0].what), "fifo:60:0");
      for (const auto& change : changes) EXPECT_TRUE(now(change, left)) << change.setting->name;
      EXPECT_THAT(take_back(journal, changes), IsEmpty());
      EXPECT_EQ(threaded_file(), "0");
      EXPECT_EQ(gro.read(interface_here("left")), before);
    }
  });
}

TEST_F(OnVeth, ThreadsOfALongerInterfaceNameAreNotTaken) {
  inside([] {
    ASSERT_EQ(std::system("ip link add left-7 type veth peer name right-7 && ip link set left-7 up"), 0);
    journal::Journal journal(kinds());
    apply(journal, {{"gro", "on"}, {"threaded-napi", "on"}}, {"left-7", ""});
    apply(journal, {{"gro", "on"}, {"threaded-napi", "on"}}, left);
    const auto threads = setting("napi-threads").things("left");
    ASSERT_THAT(threads, SizeIs(1));
    EXPECT_EQ(threads[0].title().rfind('-'), std::string("napi/left").size());
  });
}

TEST_F(OnVeth, TwoSettingsOfOneThreadBothLast) {
  inside([] {
    journal::Journal journal(kinds());
    const auto changes = apply(
        journal, {{"gro", "on"}, {"threaded-napi", "on"}, {"napi-threads", "60"}, {"napi-cpus", "0"}}, left);
    for (const auto& change : changes) EXPECT_EQ(now(change, left), change.after) << change.setting->name;
  });
}

TEST_F(OnVeth, ThreadsOfItsNamesakeInAnotherNamespaceAreNotItsOwn) {
  inside([] {
    journal::Journal journal(kinds());
    journal::add_namespace(journal, "ontime-other");
    const Link other{"left", "ontime-other"};
    ASSERT_EQ(std::system("ip -n ontime-other link add left type veth peer name right && "
                          "ip -n ontime-other link set left up && ip -n ontime-other link set right up"),
              0);
    const Wishes wishes{{"gro", "on"}, {"threaded-napi", "on"}, {"napi-threads", "60"}};
    const auto refused = error_of([&] { apply(journal, wishes, left); });
    EXPECT_EQ(refused, "") << "the other one has no threads";
    EXPECT_THAT(napi_threads_by_name("left"), SizeIs(1));
    const auto also = error_of([&] {
      apply(journal, {{"gro", "on"}, {"threaded-napi", "on"}, {"napi-threads", "70"}}, other);
    });
    EXPECT_THAT(error_of([] { napi_threads_by_name("left"); }), HasSubstr("another network namespace has"));
    if (!also.empty()) return;  // before Linux 6.8
    std::vector<Thing> own, others;
    own = napi_threads_of("left");
    journal::within_namespace("ontime-other", [&] { others = napi_threads_of("left"); });
    ASSERT_THAT(own, SizeIs(1));
    ASSERT_THAT(others, SizeIs(1));
    EXPECT_THAT(*thread.read(own[0].what), StartsWith("fifo:60:"));
    EXPECT_THAT(*thread.read(others[0].what), StartsWith("fifo:70:"));
  });
}

TEST_F(OnVeth, NamesAMissingSettingBeforeAnyChange) {
  inside([] {
    journal::Journal journal(kinds());
    const auto steering_before = steering.read(interface_here("left") + "/rx-0");
    for (const auto& [wish, words] : std::map<std::string, std::string>{
             {"irq-cpus", "no interrupts"}, {"napi-cpus", "threaded-napi"}, {"coalescing", "coalesced"}}) {
      const Wishes wishes{{"rps", "0"}, {wish, wish == "coalescing" ? "rx-usecs=1" : "0"}};
      EXPECT_THAT(error_of([&] { apply(journal, wishes, left); }),
                  AllOf(StartsWith(wish + ": "), HasSubstr(words)));
      EXPECT_EQ(steering.read(interface_here("left") + "/rx-0"), steering_before);
    }
    const auto unthreadable = [&] { apply(journal, {{"rps", "0"}, {"threaded-napi", "on"}}, left); };
    EXPECT_THAT(error_of(unthreadable), AllOf(StartsWith("threaded-napi: "), HasSubstr("gro on")));
    EXPECT_EQ(steering.read(interface_here("left") + "/rx-0"), steering_before)
        << "what was set before is given back";
    EXPECT_THAT(error_of([&] { plan({{"rps", "0,999"}}, left); }), HasSubstr("no CPU 999"));
    EXPECT_THAT(error_of([&] {
                  plan({{"rps", "0"}}, {"nonet0", ""});
                }),
                AllOf(StartsWith("rps"), HasSubstr("nonet0")));
    EXPECT_THAT(error_of([&] { plan({{"speed", "0"}}, left); }), HasSubstr("'speed'"));
  });
}

TEST_F(OnVeth, ABridgeHasNoneOfItsOwn) {
  inside([] {
    ASSERT_EQ(std::system("ip link add bridge0 type bridge && ip link set left master bridge0"), 0);
    for (const auto& wish : Wishes{{"gro", "on"}, {"threaded-napi", "on"}, {"napi-threads", "60"}})
      EXPECT_THAT(error_of([&] {
                    plan({wish}, {"bridge0", ""});
                  }),
                  AllOf(StartsWith(wish.first + ": "), HasSubstr("bridge0 is a bridge")));
    EXPECT_EQ(error_of([] { plan({{"gro", "on"}}, left); }), "");
  });
}

TEST_F(OnVeth, LookingWritesNothing) {
  inside([] {
    ASSERT_EQ(mount("", "/sys", "", MS_REMOUNT | MS_BIND | MS_RDONLY, nullptr), 0);
    const auto states = show(left);
    const auto threads = std::find_if(states.begin(), states.end(), [](const State& one) {
      return one.setting->name == std::string("threaded-napi");
    });
    EXPECT_EQ(threads->cannot, "");
    EXPECT_EQ(plan({{"threaded-napi", "off"}}, left).at(0).before, "0");
  });
}

TEST_F(OnVeth, ChangedByAnotherIsLeftAndReported) {
  inside([] {
    journal::Journal journal(kinds());
    const auto changes = apply(journal, {{"rps", "0"}}, left);
    EXPECT_EQ(text_of("/sys/class/net/left/queues/rx-0/rps_cpus").back(), '1');
    std::ofstream("/sys/class/net/left/queues/rx-0/rps_cpus") << "2";
    EXPECT_EQ(now(changes[0], left), "1");
    EXPECT_THAT(take_back(journal, changes),
                testing::ElementsAre(AllOf(HasSubstr("left/rx-0"), HasSubstr("another program"))));
    EXPECT_EQ(steering.read(interface_here("left") + "/rx-0"), "1");
  });
}

TEST_F(OnVeth, AnotherInterfaceOfThatNameIsNotRestored) {
  inside([] {
    journal::Journal journal(kinds());
    const auto changes = apply(journal, {{"rps", "0"}, {"gro", "on"}}, left);
    const auto first = interface_here("left");
    ASSERT_EQ(std::system("ip link del left && ip link add left type veth peer name right"), 0);
    ASSERT_NE(interface_here("left"), first);
    std::ofstream("/sys/class/net/left/queues/rx-0/rps_cpus") << "1";
    EXPECT_EQ(now(changes[0], left), std::nullopt);
    EXPECT_THROW(gro.write(first, "on", "off"), journal::Error);
    EXPECT_THAT(take_back(journal, changes), IsEmpty());
    EXPECT_EQ(steering.read(interface_here("left") + "/rx-0"), "0") << "as its maker set it";
  });
}

TEST_F(OnVeth, InterfaceThatWasRenamedIsGivenBack) {
  inside([] {
    journal::Journal journal(kinds());
    const auto before = *gro.read(interface_here("left"));
    const auto changes = apply(journal, {{"rps", "0"}, {"gro", before == "on" ? "off" : "on"}}, left);
    ASSERT_EQ(std::system("ip link set left down && ip link set left name other && ip link set other up"), 0);
    EXPECT_THAT(take_back(journal, changes), IsEmpty());
    EXPECT_EQ(steering.read(interface_here("other") + "/rx-0"), "none");
    EXPECT_EQ(gro.read(interface_here("other")), before);
  });
}

TEST_F(OnVeth, InterfaceMovedAwayIsReportedAndStaysInTheJournal) {
  inside([] {
    journal::Journal journal(kinds());
    journal::add_namespace(journal, "ontime-other");
    const auto changes = apply(journal, {{"rps", "0"}}, left);
    ASSERT_EQ(std::system("ip link set left netns ontime-other"), 0);
    EXPECT_THAT(take_back(journal, changes),
                testing::ElementsAre(AllOf(HasSubstr("left"), HasSubstr("another network namespace"))));
    // It comes back, and what was set is given back.
    ASSERT_EQ(std::system("ip -n ontime-other link set left netns $PPID"), 0);
    EXPECT_THAT(take_back(journal, changes), IsEmpty());
    EXPECT_EQ(steering.read(interface_here("left") + "/rx-0"), "none");
  });
}

TEST_F(OnVeth, InterfaceMovedIntoAContainerIsReportedUntilThatEnds) {
  inside([] {
    journal::Journal journal(kinds());
    const auto changes = apply(journal, {{"rps", "0"}}, left);
    test::Victim container([](journal::Journal&) {  // its namespace has no name
      EXPECT_EQ(unshare(CLONE_NEWNET), 0);
      return "made";
    });
    ASSERT_EQ(container.said(), "made");
    ASSERT_EQ(std::system(fmt::format("ip link set left netns {}", container.pid()).c_str()), 0);
    EXPECT_THAT(take_back(journal, changes),
                testing::ElementsAre(AllOf(HasSubstr("left"), HasSubstr("another network namespace"))));
    container.kill_9();
    container.wait();
    EXPECT_THAT(take_back(journal, changes), IsEmpty()) << "the interface went with it";
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

TEST_F(OnVeth, InterruptsThatCannotBeFoundAreRefusedWhereThereAreSome) {
  inside([] {
    const Wishes without = {{"workqueue-cpus", "0"}};
    EXPECT_EQ(away_to("0", left), without);
    ASSERT_EQ(std::system("ip link add bridge0 type bridge"), 0);
    EXPECT_THAT(error_of([] {
                  away_to("0", {"bridge0", ""});
                }),
                AllOf(StartsWith("irq-cpus: "), HasSubstr("bridge0"), HasSubstr("interface below it")));
    ASSERT_EQ(std::system("ip link set left master bridge0"), 0);
    EXPECT_EQ(away_to("0", {"bridge0", ""}), without) << "the one below it has none";
  });
}

TEST_F(OnVeth, AKilledProcessesChangesAreRestored) {
  inside([] {
    test::Victim victim(
        [](journal::Journal& journal) {
          apply(journal, {{"gro", "on"}, {"threaded-napi", "on"}, {"napi-threads", "60"}, {"rps", "1"}},
                left);
          return "set";
        },
        kinds());
    EXPECT_EQ(victim.said(), "set");
    victim.kill_9();
    EXPECT_EQ(threaded_file(), "1");
    EXPECT_THAT(journal::revert_abandoned(kinds()), SizeIs(4));
    EXPECT_EQ(threaded_file(), "0");
    EXPECT_EQ(steering.read(interface_here("left") + "/rx-0"), "none");
  });
}

TEST_F(OnVeth, AppliedSettingsStayUntilTheRevert) {
  inside([] {
    {
      journal::Journal journal(kinds());
      apply(journal, {{"rps", "1"}}, left);
      journal.keep();
    }
    EXPECT_EQ(steering.read(interface_here("left") + "/rx-0"), "1");
    EXPECT_THAT(journal::revert_abandoned(kinds()), IsEmpty()) << "it is not abandoned";
    {
      journal::Journal run(kinds());  // changes the same, and gives back what was kept
      apply(run, {{"rps", "0"}}, left);
      EXPECT_EQ(journal::kept(kinds()).at(0).now, "0");
    }
    auto kept = journal::kept(kinds());
    ASSERT_THAT(kept, SizeIs(1));
    EXPECT_EQ(kept[0].before, "none");
    EXPECT_EQ(kept[0].after, "1");
    EXPECT_EQ(kept[0].now, "1");
    {
      journal::Journal again(kinds());
      const auto changes = apply(again, {{"rps", "0-1"}, {"gro", *gro.read(interface_here("left"))}}, left);
      remember(again, changes, left);
      again.keep();
    }
    kept = journal::kept(kinds());
    ASSERT_THAT(kept, SizeIs(2)) << "what was so already is to stay so, too";
    EXPECT_EQ(kept[0].after, "0-1");
    journal::Journal revert(kinds());
    const auto given_back = revert.revert_kept();
    EXPECT_TRUE(given_back.finished);
    EXPECT_THAT(given_back.done, SizeIs(2));
    EXPECT_EQ(steering.read(interface_here("left") + "/rx-0"), "none");
    EXPECT_THAT(journal::kept(kinds()), IsEmpty());
  });
}

}  // namespace
}  // namespace ontime::settings

int main(int argc, char** argv) {
  testing::AddGlobalTestEnvironment(new ontime::test::OwnRun);
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}

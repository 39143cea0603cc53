// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <fstream>

#include <fmt/format.h>

#include "own_run.hpp"
#include "settings/kinds.hpp"
#include "settings/settings.hpp"
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
    EXPECT_THAT(threads->things, SizeIs(1));
    EXPECT_THAT(threads->cannot, HasSubstr("read-only here"));
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

// As after nsenter --net: /sys still shows the network namespace from which it was mounted.
TEST_F(OnVeth, AnInterfaceOfTheSameNameInAnotherNamespaceIsNotTouched) {
  inside([] {
    ASSERT_EQ(unshare(CLONE_NEWNET), 0);
    ASSERT_EQ(std::system("ip link add left type veth peer name right"), 0);
    journal::Journal journal(kinds());
    for (const auto& wishes :
         {Wishes{{"rps", "0"}}, Wishes{{"threaded-napi", "on"}}, Wishes{{"irq-cpus", "0"}}})
      EXPECT_THAT(error_of([&] { apply(journal, wishes, left); }), HasSubstr("mount -t sysfs"));
    EXPECT_EQ(text_of("/sys/class/net/left/queues/rx-0/rps_cpus").find_first_not_of("0,\n"),
              std::string::npos);
  });
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

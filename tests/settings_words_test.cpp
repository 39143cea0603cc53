// SPDX-License-Identifier: Apache-2.0
// What people write for a setting, and what they are shown.
#include <array>
#include <cstdio>
#include <fstream>

#include <sched.h>
#include <sys/mount.h>

#include "own_run.hpp"
#include "settings/kinds.hpp"
#include "settings_fixture.hpp"

namespace ontime::settings {
namespace {

using testing::AllOf;
using testing::HasSubstr;

std::string refused(const std::string& name, const std::string& value) {
  try {
    setting(name).stated(value);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

TEST(Words, InvalidValuesAreRefused) {
  for (const auto& [name, values] : std::map<std::string, std::vector<std::string>>{
           {"ksoftirqd", {"1", "99", "other", "0=60", "0=60,1=other"}},
           {"irq-threads", {"90", "other"}},
           {"threaded-napi", {"on", "off"}},
           {"rps", {"none", "0-1,3"}},
           {"napi-cpus", {"1"}},
           {"rmem-max", {"4608", "8388608"}},
           {"governor", {"performance"}},
           {"coalescing", {"rx-usecs=0", "rx-usecs=10,adaptive-rx=off"}}})
    for (const auto& value : values) EXPECT_EQ(refused(name, value), "") << name;
  for (const auto& [name, values] : std::map<std::string, std::vector<std::string>>{
           {"ksoftirqd",
            {"0", "100", "fast", "60,70", "0=60,70", "x=60", "0=", "", "0=60,0=50", "0=60,00=50", "0=60,"}},
           {"irq-threads", {"0", "0=60", "-1", "60 "}},
           {"threaded-napi", {"1", "yes"}},
           {"rps", {"none,1", "1-", "-"}},
           {"rmem-max", {"0", "4607", "8 MiB", "99999999999"}},
           {"governor", {"../x", "Performance"}},
           {"coalescing",
            {"", "rx-usecs", "rx-usecs=", "rx-usecs=-1", "speed=1", "adaptive-rx=1", "rx-usecs=3,rx-usecs=90",
             "rx-usecs=3,"}}})
    for (const auto& value : values) EXPECT_NE(refused(name, value), "") << name << ' ' << value;
}

// So '90' and '090' are no two runs, and no difference between two.
TEST(Words, AValueHasOneSpelling) {
  for (const auto& [name, value, spelling] : std::vector<std::array<std::string, 3>>{
           {"irq-threads", "090", "90"},
           {"ksoftirqd", "060", "60"},
           {"ksoftirqd", "01=other,0=060", "0=60,1=other"},
           {"rps", "1,0,00", "0-1"},
           {"rps", "none", "none"},
           {"irq-cpus", "0-1,2", "0-2"},
           {"busy-poll", "-0", "0"},
           {"rmem-max", "04608", "4608"},
           {"coalescing", "adaptive-rx=off,rx-usecs=00", "rx-usecs=0,adaptive-rx=off"},
           {"rt-throttling", "off", "off"}})
    EXPECT_EQ(setting(name).stated(value), spelling) << name;
}

TEST(Words, OneCpuHasAPriorityOfItsOwn) {
  const std::string name = "ksoftirqd";
  const auto& ksoftirqd = setting(name);
  const Thing first{&thread_priority, "14:25:ksoftirqd/0"}, second{&thread_priority, "22:25:ksoftirqd/1"};
  EXPECT_EQ(ksoftirqd.wanted("60", first, "other:0"), "fifo:60");
  EXPECT_EQ(ksoftirqd.wanted("0=60", second, "other:-5"), "") << "it stays as it is";
  EXPECT_EQ(ksoftirqd.wanted("0=60", first, "other:0"), "fifo:60");
  EXPECT_THROW(ksoftirqd.wanted("0=60,1000=50", first, "other:0"), journal::Error) << "there is no CPU 1000";
  EXPECT_EQ(ksoftirqd.wanted("other", first, "fifo:60"), "other:0");
  EXPECT_EQ(ksoftirqd.wanted("other", first, "other:-5"), "other:-5") << "its niceness stays";
  EXPECT_THROW(ksoftirqd.wanted("60", first, "policy 6:0"), journal::Error) << "what cannot be given back";
}

TEST(Words, ValueThatIsShownIsOneThatCanBeSet) {
  const Thing first{&thread_priority, "14:25:ksoftirqd/0"}, file{&kernel_sysctl, "kernel/timer_migration"};
  const auto shown = [](const char* name, const Thing& thing, const std::string& now) {
    return value_that_keeps(setting(name), thing, now);
  };
  EXPECT_EQ(shown("ksoftirqd", first, "fifo:60"), "60");
  EXPECT_EQ(shown("ksoftirqd", first, "other:0"), "other");
  EXPECT_EQ(shown("timer-migration", file, "1"), "on");
  EXPECT_EQ(shown("rt-throttling", file, "-1"), "off");
  EXPECT_EQ(shown("busy-poll", file, "50"), "50 us");
  EXPECT_EQ(shown("rmem-max", file, "212992"), "212992 B");
  EXPECT_EQ(shown("ksoftirqd", first, "policy 6:0"), "policy 6:0") << "no value of ontime's";
  EXPECT_EQ(shown("rt-throttling", file, "700000"), "700000");
}

TEST(Words, ThrottlingLeavesAPartOfThePeriodThatThisMachineHas) {
  if (!test::has_own_run) GTEST_SKIP() << "needs root";
  const Thing file{&kernel_sysctl, "kernel/sched_rt_runtime_us"};
  test::in_child([&] {
    ASSERT_EQ(unshare(CLONE_NEWNS), 0);
    const std::string period = "/run/ontime-test-period";
    std::ofstream(period) << "100000\n";
    ASSERT_EQ(mount(period.c_str(), "/proc/sys/kernel/sched_rt_period_us", nullptr, MS_BIND, nullptr), 0);
    EXPECT_EQ(setting("rt-throttling").wanted("on", file, "-1"), "95000");
    EXPECT_EQ(setting("rt-throttling").wanted("off", file, "95000"), "-1");
    EXPECT_EQ(value_that_keeps(setting("rt-throttling"), file, "95000"), "on");
  });
  std::remove("/run/ontime-test-period");
}

TEST(Words, ValuesOfAllThingsAreOneThatCanBeSet) {
  const Thing first{&thread_priority, "14:25:ksoftirqd/0"}, second{&thread_priority, "22:25:ksoftirqd/1"};
  const auto shown = [&](const std::string& of_first, const std::string& of_second) {
    return values_that_keep({&setting("ksoftirqd"), {{first, of_first}, {second, of_second}}, ""});
  };
  EXPECT_EQ(shown("other:0", "other:0"), "other");
  EXPECT_EQ(shown("fifo:60", "other:0"), "0=60,1=other");
  EXPECT_EQ(refused("ksoftirqd", shown("fifo:60", "other:0")), "");
  const auto interrupts = [&](const std::string& last) {
    return values_that_keep({&setting("irq-cpus"),
                             {{{&interrupt, "37:PCI-MSI 1"}, "0"}, {{&interrupt, "38:PCI-MSI 2"}, last}},
                             ""});
  };
  EXPECT_EQ(interrupts("0"), "0");
  EXPECT_EQ(interrupts("1"), "interrupt 37 0, interrupt 38 1");
  EXPECT_EQ(values_that_keep({&setting("irq-cpus"), {}, ""}), "");
}

TEST(Words, RefusedPartOfAListIsNamed) {
  EXPECT_THAT(refused("ksoftirqd", "60,governor=performance"), HasSubstr("'60' is not CPU=PRIORITY"));
}

TEST(Words, RefusedPriorityNamesTheOtherForms) {
  EXPECT_THAT(refused("irq-threads", "fast"), AllOf(HasSubstr("1 to 99"), HasSubstr("other")));
  EXPECT_THAT(refused("ksoftirqd", "fast"), AllOf(HasSubstr("1 to 99"), HasSubstr("0=60,1=other")));
}

TEST(Words, CoalescingChangesOnlyTheStatedFields) {
  EXPECT_EQ(with_coalescing("rx-usecs=3,rx-frames=0,tx-usecs=5,tx-frames=0,adaptive-rx=on,adaptive-tx=off",
                            "rx-usecs=0,adaptive-rx=off"),
            "rx-usecs=0,rx-frames=0,tx-usecs=5,tx-frames=0,adaptive-rx=off,adaptive-tx=off");
}

}  // namespace
}  // namespace ontime::settings
